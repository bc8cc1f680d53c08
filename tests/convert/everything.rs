//! A description of everything that there is, with numbers of many digits.

use crate::support::{self, Random};
use embrace::bsdf::{CoatTable, Distribution};
use embrace::camera::CameraDesc;
use embrace::image::Image;
use embrace::light::Emission;
use embrace::material::{
    Back, Channel, Checkerboard, General, Material, Principled, Relief, Scalar, Scattering, Spectrum,
};
use embrace::math::{Affine2, DAffine3, DMat3, DVec3, Rgb, Vec2, Vec3};
use embrace::mesh::TriangleMesh;
use embrace::scene::{EnvironmentDesc, Falloff, LightDesc, ObjectDesc, SceneDesc, SlideDesc};
use embrace::texture::{Encoding, Filter, Texture, TextureMap, Wrap};
use std::sync::Arc;

fn rgb(random: &mut Random) -> Rgb {
    Rgb::new(random.unit(), random.unit(), random.unit())
}

fn double(random: &mut Random) -> f64 {
    (random.bits() >> 11) as f64 / 9_007_199_254_740_992.0
}

/// A map of one of the bitmaps, in one of the ways there are.
fn texture_map(random: &mut Random, texture: u32) -> TextureMap {
    let wraps = [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp];
    TextureMap {
        to_uv: Affine2::from_scale_angle_translation(
            Vec2::new(0.5 + random.unit(), 1.0 + random.unit()),
            random.unit(),
            Vec2::new(random.unit(), -random.unit()),
        ),
        wrap: [wraps[random.below(3)], wraps[random.below(3)]],
        filter: [Filter::Bilinear, Filter::Nearest][random.below(2)],
        ..TextureMap::new(texture)
    }
}

fn spectra(random: &mut Random) -> Vec<Spectrum> {
    let mut spectra = vec![
        Spectrum::Constant(rgb(random)),
        Spectrum::Constant(Rgb::splat(random.unit())),
        Spectrum::Checkerboard(Checkerboard {
            to_uv: Affine2::from_scale(Vec2::new(3.0, 1.0 / 3.0)),
            colors: [rgb(random), rgb(random)],
        }),
        Spectrum::VertexColor(None, Rgb::WHITE),
        Spectrum::VertexColor(Some(texture_map(random, 1)), rgb(random)),
        Spectrum::Bitmap(TextureMap::new(0), Rgb::WHITE),
    ];
    for texture in 0..TEXTURES {
        spectra.push(Spectrum::Bitmap(texture_map(random, texture), rgb(random)));
    }
    spectra
}

const TEXTURES: u32 = 3;

fn textures(random: &mut Random) -> Vec<Texture> {
    let mut bytes = |width: u32, height: u32| Image {
        width,
        height,
        pixels: (0..width * height)
            .map(|_| [0; 3].map(|_: u8| random.bits() as u8))
            .collect(),
    };
    let (srgb, linear) = (bytes(3, 2), bytes(5, 4));
    vec![
        Texture::Rgb8(srgb, Encoding::Srgb),
        Texture::Rgb8(linear, Encoding::Linear),
        Texture::Rgb32(Image {
            width: 2,
            height: 3,
            pixels: (0..6).map(|_| rgb(random)).collect(),
        }),
        // Heights, and factors on emission.
        Texture::Rgb32(Image {
            width: 2,
            height: 2,
            pixels: (0..4).map(|i| rgb(random) * 1.7 - Rgb::splat(i as f32 / 3.0)).collect(),
        }),
        Texture::Rgb32(Image {
            width: 2,
            height: 2,
            pixels: (0..4).map(|_| rgb(random) * 31.7).collect(),
        }),
    ]
}

/// Every kind of scattering, most of them with every kind of colour.
fn scatterings(random: &mut Random) -> Vec<Scattering> {
    let mut all = vec![
        Scattering::Conductor {
            eta: rgb(random) + Rgb::splat(0.1),
            k: rgb(random) * 3.0,
            alpha: random.unit(),
        },
        Scattering::Dielectric {
            ior: 1.0 + random.unit(),
            alpha: 0.0,
        },
        Scattering::Dielectric {
            ior: 0.01,
            alpha: random.unit(),
        },
        Scattering::Mirror {
            reflectance: rgb(random),
        },
        Scattering::General(General::Metal {
            eta: Rgb::BLACK,
            k: Rgb::WHITE,
            reflectance: Spectrum::Constant(Rgb::WHITE),
            alpha: [Scalar::Constant(0.0); 2],
            distribution: Distribution::Ggx,
        }),
    ];
    let channels = [Channel::R, Channel::G, Channel::B, Channel::Mean, Channel::Luminance];
    for (i, spectrum) in spectra(random).into_iter().enumerate() {
        let varying = Scalar::Varying(spectrum, channels[i % 5]);
        let other = [Scalar::Constant(random.unit()), varying][i % 2];
        let distribution = [Distribution::Ggx, Distribution::Beckmann][i % 2];
        let coat = CoatTable::of(1.5, [0.0, 0.1][i % 2], distribution);
        all.extend([
            Scattering::Diffuse { reflectance: spectrum },
            Scattering::Plastic {
                reflectance: spectrum,
                specular: rgb(random),
                alpha: [1e-3, random.unit()][i % 2],
            },
            Scattering::General(General::Metal {
                eta: rgb(random),
                k: rgb(random),
                reflectance: spectrum,
                alpha: [other, varying],
                distribution,
            }),
            Scattering::General(General::Glass {
                ior: 1.0 + random.unit(),
                reflectance: Spectrum::Constant(Rgb::WHITE),
                transmittance: spectrum,
                alpha: [other; 2],
                distribution,
            }),
            Scattering::General(General::ThinGlass {
                ior: 1.0 + random.unit(),
                reflectance: spectrum,
                transmittance: Spectrum::Constant(rgb(random)),
            }),
            Scattering::General(General::CoatedDiffuse {
                reflectance: spectrum,
                specular: Spectrum::Constant(Rgb::splat(random.unit())),
                coat,
                nonlinear: i % 2 == 0,
            }),
            Scattering::General(General::Principled(Box::new(Principled {
                roughness: varying,
                anisotropic: other,
                metallic: Scalar::Constant(random.unit()),
                spec_trans: Scalar::Constant([0.0, random.unit()][i % 2]),
                ior: 1.1 + random.unit(),
                spec_tint: other,
                sheen: varying,
                sheen_tint: Scalar::Constant(random.unit()),
                flatness: other,
                clearcoat: Scalar::Constant(random.unit()),
                // Each coat has its own.
                clearcoat_gloss: if i % 2 == 0 { Scalar::Constant(0.0) } else { varying },
                clearcoat_roughness: if i % 2 == 0 { varying } else { Scalar::Constant(0.0) },
                specular: other,
                specular_color: Spectrum::Constant(rgb(random)),
                conserves: i % 2 == 0,
                thin: i % 4 == 1,
                ..Principled::new(spectrum)
            }))),
            Scattering::General(General::Blend {
                weight: varying,
                materials: [0, 1 + i as u32 % 4],
            }),
        ]);
    }
    all
}

fn materials(random: &mut Random) -> Vec<(String, Material)> {
    let names = [
        "plain",
        "",
        "with space",
        "black",
        "same",
        "plain",
        "quo\"te\\",
        "ä.b",
        "plain-2",
    ];
    let opacities = spectra(random);
    let materials = scatterings(random).into_iter().enumerate().map(|(i, scattering)| {
        let relief = match i % 4 {
            1 => Some(Relief::NormalMap {
                map: texture_map(random, 1),
                scale: random.unit(),
            }),
            2 => Some(Relief::BumpMap {
                map: texture_map(random, 3),
                scale: -0.1 * random.unit(),
            }),
            _ => None,
        };
        let back = match i % 7 {
            3 => Back::Black,
            // None of the first, which blends refer to, refers to others.
            5 if i > 5 => Back::Material(i as u32 % 5),
            _ => Back::Same,
        };
        let material = Material {
            scattering,
            // None of those that others refer to has any.
            opacity: (i % 3 == 2 && i > 4).then(|| opacities[i / 3 % opacities.len()]),
            relief,
            back,
        };
        (names[i % names.len()].to_owned(), material)
    });
    materials.collect()
}

fn lights(random: &mut Random) -> Vec<LightDesc> {
    let mut lights = vec![
        LightDesc::Distant {
            direction: DVec3::NEG_Y,
            irradiance: Rgb::WHITE,
            radius: 0.0,
        },
        LightDesc::Distant {
            direction: DVec3::new(0.3, -1.0, 0.1),
            irradiance: rgb(random),
            radius: 0.265f64.to_radians(),
        },
    ];
    for falloff in [Falloff::Angle, Falloff::Cosine] {
        for _ in 0..4 {
            let position = DVec3::new(double(random), 2.0 + double(random), double(random));
            lights.push(LightDesc::Point {
                position,
                intensity: rgb(random) * 3.0,
            });
            let beam = double(random);
            let casts = |factor: &Spectrum| matches!(factor, Spectrum::Bitmap(..) | Spectrum::Checkerboard(_));
            let slide = spectra(random).into_iter().rfind(casts).map(|factor| SlideDesc {
                factor,
                axes: [DVec3::X * double(random), DVec3::new(0.0, -1.0, double(random))],
            });
            lights.push(LightDesc::Spot {
                slide,
                position,
                direction: DVec3::new(double(random), -3.0 * double(random), double(random)),
                intensity: rgb(random),
                angles: [beam, beam + 0.5 * double(random)],
                falloff,
            });
        }
    }
    lights
}

/// A patch of the floor with everything that a mesh can have.
fn patch(random: &mut Random, everything: bool) -> TriangleMesh<DVec3> {
    let mesh = support::quad(Vec3::ZERO, Vec3::Z, Vec3::X).into_f64();
    let vertices = mesh.positions.len();
    let mesh = TriangleMesh {
        positions: mesh
            .positions
            .iter()
            .map(|p| *p + DVec3::Y * (0.1 * double(random)))
            .collect(),
        ..mesh
    };
    if !everything {
        return mesh;
    }
    let mut mesh = TriangleMesh {
        normals: (0..vertices)
            .map(|_| Vec3::new(random.unit() - 0.5, 1.0, random.unit() - 0.5))
            .collect(),
        colors: (0..vertices).map(|_| rgb(random)).collect(),
        ..mesh
    };
    mesh.repair_normals();
    mesh
}

/// A floor with one patch for each material, under lights of every kind.
pub(crate) fn everything() -> SceneDesc {
    let random = &mut Random(7);
    let materials = materials(random);
    let meshes: Vec<_> = (0..8).map(|i| Arc::new(patch(random, i % 2 == 0))).collect();
    let emission_maps = [
        None,
        Some(Spectrum::Bitmap(texture_map(random, 4), Rgb::splat(2.5))),
        Some(Spectrum::VertexColor(None, Rgb::WHITE)),
        Some(Spectrum::Bitmap(texture_map(random, 0), Rgb::WHITE)),
    ];
    let columns = 12;
    let objects = (0..materials.len()).map(|i| {
        let is_lamp = i % 9 == 4;
        ObjectDesc {
            name: format!("patch \"{i}\"\nof the floor"),
            mesh: (i * 5) % 8,
            material: i,
            to_world: DAffine3::from_translation(DVec3::new((i % columns) as f64, 0.0, (i / columns) as f64))
                * DAffine3::from_rotation_y(0.1 * double(random))
                * DAffine3::from_scale(DVec3::new(0.9, 1.0, [0.9, -0.8][i % 2])),
            emission: is_lamp.then(|| Emission {
                radiance: rgb(random) * 7.0,
                both_sides: i % 2 == 0,
            }),
            emission_map: emission_maps[i / 9 % 4].filter(|_| is_lamp),
        }
    });
    let objects = objects.collect();
    let rows = materials.len() as f64 / columns as f64;
    SceneDesc {
        crop: Some([1, 2, 7, 5]),
        camera: CameraDesc {
            position: DVec3::new(6.0 + double(random), 12.0, rows + 4.0),
            look_at: DVec3::new(6.0, 0.0, 0.5 * rows),
            up: DVec3::new(0.01 * double(random), 1.0, 0.0),
            vfov_degrees: 50.0 + double(random),
            resolution: [48, 36],
            aperture_radius: 0.01 * double(random),
            focus_distance: Some(11.0 + double(random)),
            mirrored: true,
        },
        max_depth: Some(5),
        environment: Some(EnvironmentDesc::Map {
            image: Arc::new(Image {
                width: 8,
                height: 4,
                pixels: (0..32).map(|_| rgb(random) * 3.0).collect(),
            }),
            scale: 0.3,
            rotation_degrees: 31.0 + double(random),
            to_world: DMat3::from_rotation_x(double(random)) * DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0)),
        }),
        objects,
        materials,
        textures: textures(random),
        meshes,
        lights: lights(random),
        hash: String::new(),
        warnings: vec!["something was left out".into()],
    }
}
