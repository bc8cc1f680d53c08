#!/usr/bin/env python3
"""Renders the reference images of this folder with Mitsuba 3 from the scene files in `scenes/`.

usage: make_references.py [--batches N] [--spp N] [SCENE ..]

For each scene writes NAME.exr, the mean over independent batches, and NAME.variance.exr, the variance of that mean per
pixel and channel, estimated from the spread of the batches. README.md says what the images are good for.
"""
import argparse
import os
import sys
import tempfile
import time
import tomllib

import numpy as np
import OpenEXR

import mitsuba as mi

mi.set_variant("llvm_ad_rgb")

HERE = os.path.dirname(os.path.abspath(__file__))
SCENES = os.path.join(HERE, "..", "..", "scenes")
# Samples per pixel of one batch: about as many as make the references alike in error for their cost.
SAMPLES = {"spheres": 1024, "cornell": 384, "veach-mis": 1024, "glass": 1024, "furnace": 256, "many-lights": 1024}
WIDTH = 64


def read_exr(path):
    with OpenEXR.File(path) as f:
        return np.asarray(f.channels()["RGB"].pixels, dtype=np.float32)


def write_exr(path, pixels):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB": np.ascontiguousarray(pixels, dtype=np.float32)}).write(path)


def read_obj(path):
    """Positions, normals, texture coordinates (or None) and triangles; one index serves all attributes of a corner."""
    lists = {"v": [], "vn": [], "vt": [], "f": []}
    with open(path, encoding="utf-8") as f:
        for line in f:
            keyword, *values = line.split()
            if keyword == "f":
                corners = [{int(i) for i in corner.split("/") if i} for corner in values]
                assert len(corners) == 3 and all(len(c) == 1 for c in corners), path
                lists["f"].append([c.pop() - 1 for c in corners])
            else:
                lists[keyword].append([float(v) for v in values])
    array = lambda key: np.array(lists[key]) if lists[key] else None
    return array("v"), array("vn"), array("vt"), np.array(lists["f"])


def mesh_to_world(mesh, matrix):
    positions, normals, uvs, triangles = mesh
    positions = positions @ matrix[:3, :3].T + matrix[:3, 3]
    if normals is not None:
        normals = normals @ np.linalg.inv(matrix[:3, :3])
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    if np.linalg.det(matrix[:3, :3]) < 0:
        triangles = triangles[:, ::-1]
    return positions, normals, uvs, triangles


def write_ply(path, mesh):
    positions, normals, uvs, triangles = mesh
    columns, names = [positions], ["x", "y", "z"]
    if normals is not None:
        columns.append(normals)
        names += ["nx", "ny", "nz"]
    if uvs is not None:
        # Mitsuba's v = 0 is the top row of the image, ours the bottom row.
        columns.append(np.stack([uvs[:, 0], 1 - uvs[:, 1]], -1))
        names += ["u", "v"]
    faces = np.empty(len(triangles), dtype=[("n", "u1"), ("i", "<i4", 3)])
    faces["n"], faces["i"] = 3, triangles
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(positions)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header", ""]
    with open(path, "wb") as f:
        f.write("\n".join(header).encode() + np.concatenate(columns, 1).astype("<f4").tobytes() + faces.tobytes())


def rgb(value):
    return {"type": "rgb", "value": [float(v) for v in value]}


def take(table, context, *known):
    """The values of the known keys; any other key is one that this script does not convert."""
    unknown = set(table) - set(known)
    if unknown:
        raise ValueError(f"{context}: {sorted(unknown)} not supported")
    return [table.get(key) for key in known]


def convert_material(folder, name, material):
    kind = material["type"]
    if kind == "diffuse":
        _, colour, texture = take(material, name, "type", "rgb", "texture")
        if texture:
            path = os.path.join(folder, texture)
            colour = {"type": "bitmap", "filename": path, "filter_type": "bilinear", "wrap_mode": "repeat"}
        else:
            colour = rgb(colour)
        return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": colour}}
    if kind == "conductor":
        _, eta, k, alpha = take(material, name, "type", "eta", "k", "alpha")
        rough = {"type": "roughconductor", "distribution": "ggx", "alpha": alpha} if alpha else {"type": "conductor"}
        return {"type": "twosided", "bsdf": {**rough, "eta": rgb(eta), "k": rgb(k)}}
    if kind == "dielectric":
        _, ior, alpha = take(material, name, "type", "ior", "alpha")
        rough = {"type": "roughdielectric", "distribution": "ggx", "alpha": alpha} if alpha else {"type": "dielectric"}
        return {**rough, "int_ior": float(ior), "ext_ior": 1.0}
    raise ValueError(f"{name}: material type {kind} not supported")


def convert_mesh(folder, temporary, index, mesh):
    file, material, transform, emission = take(
        mesh, f"mesh {index}", "file", "material", "transform", "emission"
    )
    data = read_obj(os.path.join(folder, file))
    if transform is not None:
        data = mesh_to_world(data, np.array(transform, dtype=float))
    path = os.path.join(temporary, f"{index}.ply")
    write_ply(path, data)
    shape = {
        "type": "ply",
        "filename": path,
        "face_normals": data[1] is None,
        "bsdf": {"type": "ref", "id": f"material-{material}"},
    }
    if emission is not None:
        radiance, sides = take(emission, f"mesh {index}: emission", "radiance", "sides")
        # Mitsuba's area emitter shines on the side that the normal points to.
        if sides != "front":
            raise ValueError(f"mesh {index}: emission on both sides not supported")
        shape["emitter"] = {"type": "area", "radiance": rgb(radiance)}
    return shape


def convert_environment(folder, environment):
    file, scale, rotation = take(environment, "environment", "file", "scale", "rotation_deg")
    texels = read_exr(os.path.join(folder, file))
    # Our rows lie at (j + 1/2) / H, Mitsuba's at j / (H - 1). Rows put between ours and a repeated first and last one
    # make the same bilinear function.
    rows = np.empty((2 * len(texels) + 1, *texels.shape[1:]), np.float32)
    rows[1::2] = texels
    rows[2:-1:2] = 0.5 * (texels[:-1] + texels[1:])
    rows[0], rows[-1] = texels[0], texels[-1]
    return {
        "type": "envmap",
        "bitmap": mi.Bitmap(rows),
        "scale": 1.0 if scale is None else float(scale),
        "to_world": mi.ScalarTransform4f().rotate([0, 1, 0], float(rotation or 0)),
    }


def convert_camera(camera, width):
    position, look_at, up, vfov, resolution = take(
        camera, "camera", "position", "look_at", "up", "vfov", "resolution"
    )
    height = width * resolution[1] / resolution[0]
    assert height == int(height), f"{width} pixels do not divide the aspect ratio {resolution}"
    distance = float(np.linalg.norm(np.subtract(look_at, position)))
    return {
        "type": "perspective",
        "fov_axis": "y",
        "fov": float(vfov),
        "near_clip": 1e-4 * distance,
        "far_clip": 1e4 * distance,
        "to_world": mi.ScalarTransform4f().look_at(origin=position, target=look_at, up=up),
        "film": {
            "type": "hdrfilm",
            "width": width,
            "height": int(height),
            "pixel_format": "rgb",
            "component_format": "float32",
            "rfilter": {"type": "box"},
        },
        "sampler": {"type": "independent"},
    }


def load_scene(path, width):
    """The Mitsuba scene of one of our scene files, `width` pixels wide."""
    folder = os.path.dirname(path)
    with open(path, "rb") as f:
        description = tomllib.load(f)
    camera, integrator, environment, materials, meshes = take(
        description, path, "camera", "integrator", "environment", "materials", "meshes"
    )
    (max_depth,) = take(integrator or {}, "integrator", "max_depth")
    scene = {
        "type": "scene",
        # We count scattering events, Mitsuba path edges.
        "integrator": {"type": "path", "max_depth": -1 if max_depth is None else max_depth + 1, "rr_depth": 5},
        "sensor": convert_camera(camera, width),
    }
    for name, material in materials.items():
        scene[f"material-{name}"] = convert_material(folder, name, material)
    if environment is not None:
        scene["environment"] = convert_environment(folder, environment)
    with tempfile.TemporaryDirectory() as temporary:
        for index, mesh in enumerate(meshes):
            scene[f"mesh-{index}"] = convert_mesh(folder, temporary, index, mesh)
        return mi.load_dict(scene)


def render_batches(scene, batches, spp, seed):
    """The mean over the batches and the variance of that mean."""
    total = squares = 0
    for batch in range(batches):
        # Sums of differences from the first batch, so that the squares keep their digits.
        image = np.array(mi.render(scene, spp=spp, seed=seed + batch), dtype=np.float64)
        first = image if batch == 0 else first
        total = total + (image - first)
        squares = squares + (image - first) ** 2
    variance = (squares - total**2 / batches) / (batches - 1) / batches
    return first + total / batches, np.maximum(variance, 0)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--batches", type=int, default=64)
    parser.add_argument("--spp", type=int, help="samples per pixel of one batch")
    parser.add_argument("scenes", nargs="*", default=list(SAMPLES), metavar="SCENE")
    arguments = parser.parse_args()
    for name in arguments.scenes:
        scene = load_scene(os.path.join(SCENES, name, name + ".toml"), WIDTH)
        start = time.perf_counter()
        spp = arguments.spp or SAMPLES[name]
        mean, variance = render_batches(scene, arguments.batches, spp, 1000 * (1 + list(SAMPLES).index(name)))
        write_exr(os.path.join(HERE, f"{name}.exr"), mean)
        write_exr(os.path.join(HERE, f"{name}.variance.exr"), variance)
        error = np.sqrt(variance) / np.maximum(mean, 1e-3)
        squared = np.mean(variance / (mean**2 + 0.01))
        print(
            f"{name}: {arguments.batches} x {spp} spp, mean {np.round(mean.mean((0, 1)), 4)}, relative error of the whole image's mean {np.sqrt(variance.sum()) / mean.sum():.1e}, "
            f"relative standard error median {np.median(error):.1e}, 99 % {np.quantile(error, 0.99):.1e}, "
            f"largest {error.max():.1e}, relMSE {squared:.1e}, {time.perf_counter() - start:.0f} s"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
