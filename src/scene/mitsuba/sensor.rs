//! The view: sensor, film and filter; and the integrator's depth.

use super::super::load::LoadError;
use super::Importer;
use super::document::{Tag, Value};
use super::props::Props;
use super::xml_value::number;
use crate::camera::{CameraDesc, MAX_SIDE};
use crate::math::DMat3;

/// Diagonal of 35 mm film [mm], which focal lengths refer to.
const FILM_DIAGONAL: f64 = 43.266_615_305_567_87;

/// The side that an angle of view is across.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Axis {
    X,
    Y,
    Diagonal,
    Smaller,
    Larger,
}

const AXES: [(&str, Axis); 5] = [
    ("x", Axis::X),
    ("y", Axis::Y),
    ("diagonal", Axis::Diagonal),
    ("smaller", Axis::Smaller),
    ("larger", Axis::Larger),
];

impl Importer<'_> {
    /// The camera, and the part of its image that is wanted.
    pub(super) fn sensor(&mut self, node: usize) -> Result<(CameraDesc, Option<[u32; 4]>), LoadError> {
        let mut props = Props::new(self.document, node);
        let is_thin_lens = match props.node.plugin.as_str() {
            "perspective" => false,
            "thinlens" => true,
            _ => return Err(props.error("is not supported; supported sensors: perspective, thinlens")),
        };
        // The shutter stays open for nothing that moves.
        props.ignore(&["shutter_open", "shutter_close"]);
        for name in ["principal_point_offset_x", "principal_point_offset_y"] {
            props.float_in(name, 0.0, 0.0..=0.0)?;
        }
        let near = props.float("near_clip")?;
        let far = props.float("far_clip")?;
        if near.is_some() || far.is_some() {
            let place = self.document.describe(props.node.place);
            self.warn(format!(
                "{place}: near_clip and far_clip are ignored: the camera sees at all distances"
            ));
        }
        self.sampler(&mut props)?;
        let (resolution, crop) = self.film(&mut props)?;
        let aspect = f64::from(resolution[0]) / f64::from(resolution[1]);
        let vfov_degrees = vertical_angle(&mut props, aspect)?;

        let to_world = props.take_to_world()?;
        let matrix = to_world.matrix3;
        let is_rotation = (matrix.transpose() * matrix - DMat3::IDENTITY).abs_diff_eq(DMat3::ZERO, 1e-3);
        if !is_rotation {
            return Err(
                props.error("has a to_world that scales or shears; expected rotations, mirrors and translations")
            );
        }
        let focus_distance = props.float("focus_distance")?.or(far).unwrap_or(1e4);
        let aperture_radius = match is_thin_lens {
            true => props.float("aperture_radius")?,
            false => Some(0.0),
        };
        let aperture_radius = aperture_radius.ok_or_else(|| props.error("has no parameter \"aperture_radius\""))?;
        if aperture_radius < 0.0 || focus_distance <= 0.0 {
            return Err(props.error("has a negative aperture_radius or a focus_distance that is not above 0"));
        }
        props.finish()?;
        let camera = CameraDesc {
            position: to_world.translation,
            look_at: to_world.translation + matrix.z_axis * focus_distance,
            up: matrix.y_axis,
            vfov_degrees,
            resolution,
            aperture_radius,
            focus_distance: Some(focus_distance),
            // There, x goes to the left.
            mirrored: matrix.determinant() < 0.0,
        };
        Ok((camera, crop))
    }

    /// The number of samples is for the user to choose here.
    fn sampler(&mut self, props: &mut Props) -> Result<(), LoadError> {
        let Some(sampler) = props.child(Tag::Sampler)? else {
            return Ok(());
        };
        let mut sampler = Props::new(self.document, sampler);
        let known = ["independent", "stratified", "multijitter", "orthogonal", "ldsampler"];
        if !known.contains(&sampler.node.plugin.as_str()) {
            return Err(sampler.error(format!("is not known; expected one of {}", known.join(", "))));
        }
        let count = sampler.integer("sample_count")?;
        sampler.ignore(&["seed", "jitter", "strength"]);
        let asked = count.map_or_else(String::new, |count| {
            format!(", which asks for {count} samples per pixel,")
        });
        let place = self.document.describe(sampler.node.place);
        let plugin = &sampler.node.plugin;
        self.warn(format!(
            "{place}: the sampler \"{plugin}\"{asked} is ignored: use --spp"
        ));
        sampler.finish()
    }

    fn film(&mut self, props: &mut Props) -> Result<([u32; 2], Option<[u32; 4]>), LoadError> {
        let default = ([768, 576], None);
        let Some(film) = props.child(Tag::Film)? else {
            return Ok(default);
        };
        let mut film = Props::new(self.document, film);
        if film.node.plugin != "hdrfilm" {
            return Err(film.error("is not supported; supported: hdrfilm"));
        }
        // How the file is written, and what is beyond the edges.
        film.ignore(&[
            "file_format",
            "pixel_format",
            "component_format",
            "compensate",
            "sample_border",
            "banner",
            "high_quality_edges",
        ]);
        let mut side = |name, default: u32, least: u32| match film.integer(name)? {
            None => Ok(default),
            Some(n) => match u32::try_from(n) {
                Ok(n) if (least..=MAX_SIDE).contains(&n) => Ok(n),
                _ => Err(film.error(format!("has a {name} of {n}; expected {least} to {MAX_SIDE}"))),
            },
        };
        let [width, height] = [side("width", default.0[0], 1)?, side("height", default.0[1], 1)?];
        let [x0, y0] = [side("crop_offset_x", 0, 0)?, side("crop_offset_y", 0, 0)?];
        let [crop_width, crop_height] = [side("crop_width", width, 1)?, side("crop_height", height, 1)?];
        let crop = [x0, y0, x0 + crop_width, y0 + crop_height];
        if crop[2] > width || crop[3] > height {
            return Err(film.error(format!("has a crop window beyond its {width} x {height} pixels")));
        }
        let filter = film.child(Tag::Filter)?;
        self.filter(filter, &film)?;
        film.finish()?;
        Ok(([width, height], (crop != [0, 0, width, height]).then_some(crop)))
    }

    fn filter(&mut self, filter: Option<usize>, film: &Props) -> Result<(), LoadError> {
        let (name, place) = match filter {
            None => ("gaussian", film.node.place),
            Some(filter) => {
                let mut filter = Props::new(self.document, filter);
                filter.ignore(&["radius", "stddev", "lobes", "A", "B"]);
                let found = (filter.node.plugin.as_str(), filter.node.place);
                filter.finish()?;
                found
            }
        };
        if name != "box" {
            let place = self.document.describe(place);
            self.warn(format!(
                "{place}: the reconstruction filter is \"{name}\"; rendered with a box of one pixel, which is sharper"
            ));
        }
        Ok(())
    }

    /// The largest number of scattering events of a path.
    pub(super) fn integrator(&mut self, node: usize) -> Result<Option<u32>, LoadError> {
        let mut props = Props::new(self.document, node);
        props.ignore(&["block_size", "samples_per_pass", "timeout", "rr_depth"]);
        let depth = match props.node.plugin.as_str() {
            // Media are refused: without them these are the same.
            "path" | "volpath" | "volpathmis" => {
                let depth = props.integer("max_depth")?.unwrap_or(-1);
                match u32::try_from(depth) {
                    // The last edge of a path ends at a light, where nothing scatters.
                    Ok(edges) if edges > 0 => Some(edges - 1),
                    _ if depth == -1 => None,
                    _ => {
                        return Err(props.error(format!(
                            "has a max_depth of {depth}; expected 1 or more, or -1 for no limit"
                        )));
                    }
                }
            }
            "direct" => {
                props.ignore(&["shading_samples", "emitter_samples", "bsdf_samples"]);
                Some(1)
            }
            plugin @ ("moment" | "aov") => {
                if plugin == "aov" {
                    props.ignore(&["aovs"]);
                    let place = self.document.describe(props.node.place);
                    self.warn(format!("{place}: the integrator \"aov\" is ignored: use --aov"));
                }
                let children = props.children(Tag::Integrator);
                let [child] = children[..] else {
                    return Err(props.error(format!("has {} integrators within it; expected 1", children.len())));
                };
                let depth = self.integrator(child)?;
                props.finish()?;
                return Ok(depth);
            }
            _ => {
                return Err(
                    props.error("is not supported; supported integrators: path, direct, volpath, volpathmis, and moment or aov around them")
                );
            }
        };
        if props.boolean("hide_emitters", false)? {
            return Err(props.error("has hide_emitters=true, which is not supported; remove it"));
        }
        props.finish()?;
        Ok(depth)
    }
}

/// The vertical angle of view, in degrees.
fn vertical_angle(props: &mut Props, aspect: f64) -> Result<f64, LoadError> {
    let fov = props.float("fov")?;
    let axis = props.word("fov_axis", &AXES, Axis::X)?;
    let focal_length = match props.take("focal_length").map(|property| &property.value) {
        None => None,
        Some(Value::Float(millimetres)) => Some(*millimetres),
        Some(Value::Integer(millimetres)) => Some(*millimetres as f64),
        Some(Value::String(text)) => {
            let millimetres = number(text.trim().trim_end_matches("mm"));
            Some(millimetres.map_err(|problem| props.error(format!("has a focal_length that {problem}")))?)
        }
        Some(_) => return Err(props.error("has a focal_length that is not of the form 50mm")),
    };
    let (fov, axis) = match (fov, focal_length) {
        (Some(_), Some(_)) => return Err(props.error("has both \"fov\" and \"focal_length\"; expected one of them")),
        (Some(fov), None) => (fov, axis),
        (None, length) => (
            2.0 * (FILM_DIAGONAL / (2.0 * length.unwrap_or(50.0))).atan().to_degrees(),
            Axis::Diagonal,
        ),
    };
    let tangent = (0.5 * fov.to_radians()).tan();
    let vertical = match axis {
        Axis::Y => tangent,
        Axis::Smaller if aspect > 1.0 => tangent,
        Axis::Larger if aspect <= 1.0 => tangent,
        Axis::X | Axis::Smaller | Axis::Larger => tangent / aspect,
        Axis::Diagonal => tangent / (1.0 + aspect * aspect).sqrt(),
    };
    if fov > 0.0 && fov < 180.0 {
        Ok(2.0 * vertical.atan().to_degrees())
    } else {
        Err(props.error(format!(
            "has an angle of view of {fov} degrees; expected above 0 and below 180"
        )))
    }
}
