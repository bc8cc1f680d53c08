//! Scattering functions from a mirror's limit to the widest lobe, from a view along the normal to one along the surface,
//! for indices that no material has: against f64, and within the bounds of theory.

use crate::exact;
use crate::support::{Random, for_each_in_parallel};
use embrace::bsdf::{Bsdf, Conductor, Dielectric, Diffuse, PLASTIC_MIN_ALPHA, Plastic, SMOOTH_ALPHA};
use embrace::math::{Rgb, Vec3};
use embrace::sampling::warp;
use std::sync::Mutex;

/// Unit roundoff of f32.
const ROUNDOFF: f64 = 1.0 / 16_777_216.0;

/// eta and k, from what reflects nothing to what reflects everything. (1, 0) is no surface at all.
const METALS: [(f32, f32); 10] = [
    (0.2, 3.0),
    (0.2, 1e3),
    (1e-2, 0.0),
    (1e-3, 1e3),
    (1e-6, 1e3),
    (1.0, 0.0),
    (1.000_000_1, 0.0),
    (1e3, 0.0),
    (1e3, 1e3),
    (1e6, 1e6),
];

const INDICES: [f32; 9] = [1.0, 1.000_000_1, 1.000_05, 1.0002, 1.001, 1.5, 0.5, 4.0, 100.0];

/// To the smallest cosine whose square f32 still has.
const COSINES: [f32; 10] = [1.0, 0.999_999_94, 0.7, 0.1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-7, 1e-18];

/// The widths of lobes that are no delta lobes.
const ROUGH: [f32; 5] = [SMOOTH_ALPHA, 1e-3, 0.03, 0.3, 1.0];

fn direction(cos: f32, phi: f32) -> Vec3 {
    let sin = (1.0 - f64::from(cos).powi(2)).sqrt() as f32;
    Vec3::new(sin * phi.cos(), sin * phi.sin(), cos)
}

fn metal((eta, k): (f32, f32), alpha: f32) -> Bsdf {
    Bsdf::Conductor(Conductor {
        eta: Rgb::splat(eta),
        k: Rgb::splat(k),
        alpha,
    })
}

/// From both sides.
fn glass(ior: f32, alpha: f32) -> [Bsdf; 2] {
    [ior, 1.0 / ior].map(|eta| Bsdf::Dielectric(Dielectric { eta, alpha }))
}

fn metals_and_glasses(alphas: &[f32]) -> Vec<Bsdf> {
    let of = |&alpha: &f32| {
        let glasses = INDICES.into_iter().flat_map(move |ior| glass(ior, alpha));
        METALS.into_iter().map(move |m| metal(m, alpha)).chain(glasses)
    };
    alphas.iter().flat_map(of).collect()
}

/// The most that a sample may weigh: a microfacet's reflectance times the share of them that is not hidden from `wi`, both
/// at most 1; transmitted radiance is compressed by the square of the index. Plastic draws its lobes with probabilities from
/// 0.1 to 0.9, and each carries at most 1.
fn largest_weight(bsdf: &Bsdf, transmitted: bool) -> f64 {
    match bsdf {
        Bsdf::Dielectric(d) if transmitted => f64::from(d.eta).powi(-2),
        Bsdf::Diffuse(d) => d.reflectance.g.into(),
        Bsdf::Mirror(reflectance) => reflectance.g.into(),
        Bsdf::Plastic(_) => 10.0,
        _ => 1.0,
    }
}

#[test]
fn samples_are_finite_unit_vectors_with_weights_that_theory_bounds() {
    let mut all = metals_and_glasses(&[0.0, 1e-8, 1e-6, SMOOTH_ALPHA.next_down()]);
    all.extend(metals_and_glasses(&ROUGH));
    for albedo in [0.0, 1.0] {
        let reflectance = Rgb::splat(albedo);
        all.push(Bsdf::Diffuse(Diffuse { reflectance }));
        all.push(Bsdf::Mirror(reflectance));
        for (specular, alpha) in [
            (0.0, 1.0),
            (0.04, PLASTIC_MIN_ALPHA),
            (1.0, PLASTIC_MIN_ALPHA),
            (1.0, 1.0),
        ] {
            all.push(Bsdf::Plastic(Plastic {
                reflectance,
                specular: Rgb::splat(specular),
                alpha,
            }));
        }
    }
    let mut random = Random(21);
    let last = 1f32.next_down();
    let corners = [0.0, f32::MIN_POSITIVE, 1.0 / 16_777_216.0, 0.5, last];
    let mut squares: Vec<[f32; 2]> = corners.iter().flat_map(|&u| corners.map(|v| [u, v])).collect();
    squares.extend((0..32).map(|_| random.pair()));
    let denormal = f32::from_bits(1);
    let mut heaviest = 0.0f64;
    for bsdf in &all {
        for cos in COSINES.into_iter().chain([1e-20, f32::MIN_POSITIVE, denormal, 0.0]) {
            let wo = direction(cos, 0.7);
            let mut samples = 0;
            for (lobe, u) in corners.iter().flat_map(|lobe| squares.iter().map(move |u| (*lobe, *u))) {
                let Some(sample) = bsdf.sample(wo, lobe, u) else {
                    continue;
                };
                let context = || format!("{bsdf:?}, cos {cos:e}, lobe {lobe:e}, u {u:?}: {sample:?}");
                samples += 1;
                // Four roundings of a unit vector.
                let length = sample.wi.as_dvec3().length();
                assert!((length - 1.0).abs() < 4.0 * ROUNDOFF, "{}: {length}", context());
                assert!(sample.pdf_w > 0.0, "{}", context());
                assert_eq!(sample.is_delta(), bsdf.is_delta(), "{}", context());
                let most = largest_weight(bsdf, sample.wi.z < 0.0);
                for weight in sample.weight.to_array() {
                    // The ratio of two products of ten roundings each.
                    let bound = most * (1.0 + 20.0 * ROUNDOFF);
                    assert!(weight >= 0.0 && f64::from(weight) <= bound, "{}", context());
                    heaviest = heaviest.max(f64::from(weight) / most.max(1e-30));
                }
                for eval in [bsdf.eval(wo, sample.wi), bsdf.eval(sample.wi.abs(), wo)] {
                    let values = [eval.value.r, eval.value.g, eval.value.b, eval.pdf_w];
                    assert!(
                        values.iter().all(|v| *v >= 0.0 && v.is_finite()),
                        "{}: {eval:?}",
                        context()
                    );
                }
            }
            // What reflects is not black from any angle. Of glass seen from inside, what passes is lost at grazing angles.
            let reflects = !bsdf.is_black() && !matches!(bsdf, Bsdf::Dielectric(d) if d.eta < 1.0);
            assert!(samples > 0 || !reflects, "{bsdf:?}: no sample at cos {cos:e}");
        }
    }
    println!(
        "{} scattering functions, the largest weight is {heaviest:.7} of its bound",
        all.len()
    );
}

/// What rounding the arguments can make of a function: the largest change as each is moved by a few unit roundoffs.
fn conditioning<const N: usize>(arguments: [f64; N], f: impl Fn([f64; N]) -> f64) -> f64 {
    let value = f(arguments);
    let moved = (0..N).flat_map(|i| [1.0 - 4.0 * ROUNDOFF, 1.0 + 4.0 * ROUNDOFF].map(|factor| (i, factor)));
    moved
        .map(|(i, factor)| {
            let mut arguments = arguments;
            arguments[i] *= factor;
            (f(arguments) - value).abs()
        })
        .fold(0.0, f64::max)
}

/// Reflectance of glass: the largest number below which the choice of a lobe is a reflection.
fn reflectance_of_glass(bsdf: &Bsdf, wo: Vec3) -> f32 {
    let reflects = |bits| {
        let sample = bsdf.sample(wo, f32::from_bits(bits), [0.5; 2]);
        sample.is_some_and(|s| s.wi.z > 0.0)
    };
    let (mut below, mut above) = (0, 1f32.to_bits());
    if !reflects(below) {
        return 0.0;
    }
    while above - below > 1 {
        let middle = u32::midpoint(below, above);
        *if reflects(middle) { &mut below } else { &mut above } = middle;
    }
    f32::from_bits(above)
}

#[test]
fn reflectances_are_those_of_f64_for_every_index_and_angle() {
    let (mut worst, mut worst_case) = (0.0, String::new());
    let mut check = |name: String, found: f32, exact: f64, conditioning: f64| {
        let error = (f64::from(found) - exact).abs();
        // Of a number up to 1 after some ten roundings; and what the rounding of its arguments makes.
        assert!(error <= 8.0 * ROUNDOFF + conditioning, "{name}: {found} for {exact}");
        if error > worst {
            (worst, worst_case) = (error, name);
        }
    };
    for cos in COSINES {
        let wo = direction(cos, 0.0);
        for (eta, k) in METALS {
            let found = metal((eta, k), 0.0)
                .sample(wo, 0.0, [0.5; 2])
                .expect("a mirror")
                .weight
                .g;
            let f = |[cos, eta, k]: [f64; 3]| exact::fresnel_conductor(cos.min(1.0), eta, k);
            let arguments = [cos, eta, k].map(f64::from);
            let name = format!("metal {eta:e} + {k:e} i, cos {cos:e}");
            check(name, found, f(arguments), conditioning(arguments, f));
        }
        for bsdf in INDICES.into_iter().flat_map(|ior| glass(ior, 0.0)) {
            let Bsdf::Dielectric(Dielectric { eta, .. }) = bsdf else {
                unreachable!()
            };
            let f = |[cos, eta]: [f64; 2]| exact::fresnel_dielectric(cos.min(1.0), eta);
            let arguments = [cos, eta].map(f64::from);
            let name = format!("glass {eta}, cos {cos:e}");
            check(
                name,
                reflectance_of_glass(&bsdf, wo),
                f(arguments),
                conditioning(arguments, f),
            );
        }
    }
    println!("reflectances are off by up to {worst:.1e} ({worst_case})");
}

#[test]
fn an_interface_between_equal_indices_is_not_there_at_any_angle() {
    for alpha in [0.0, 1e-3, 1.0] {
        for cos in COSINES {
            let wo = direction(cos, 0.7);
            for bsdf in glass(1.0, alpha) {
                for lobe in [0.0, 0.5, 1f32.next_down()] {
                    let sample = bsdf.sample(wo, lobe, [0.3, 0.6]).expect("light passes");
                    assert_eq!(sample.weight, Rgb::WHITE, "cos {cos:e}");
                    assert!(
                        (sample.wi + wo).length() < 4.0 * ROUNDOFF as f32,
                        "cos {cos:e}: {}",
                        sample.wi
                    );
                    let relative = (sample.wi.z / -wo.z - 1.0).abs();
                    assert!(relative < 8.0 * ROUNDOFF as f32, "cos {cos:e}: {}", sample.wi);
                }
            }
            let black = metal((1.0, 0.0), 0.0).sample(wo, 0.0, [0.5; 2]).expect("a mirror");
            assert!(
                black.weight.g < 8.0 * ROUNDOFF as f32,
                "cos {cos:e}: {:?}",
                black.weight
            );
        }
    }
}

/// The value for a pair of directions, how far it is off that of f64 for the very same numbers, and how far it may be.
/// Panics if it or the density is further off, unless so far that rounding the directions leaves nothing to compare: of a
/// lobe narrower than that.
fn checked_eval(bsdf: &Bsdf, wo: Vec3, wi: Vec3) -> [f64; 3] {
    let arguments = [wo.x, wo.y, wo.z, wi.x, wi.y, wi.z].map(f64::from);
    let eval = |[a, b, c, d, e, f]: [f64; 6]| exact::eval(bsdf, [a, b, c].into(), [d, e, f].into());
    let (found, exact) = (bsdf.eval(wo, wi), eval(arguments));
    let [value, _] = [(found.value.g, 0), (found.pdf_w, 1)].map(|(found, i)| {
        let conditioning = conditioning(arguments, |arguments| eval(arguments)[i].value);
        // Some twenty roundings, a few of them in Fresnel's equations; and what the rounding of the arguments makes.
        let rounding = 16.0 * ROUNDOFF * (exact[i].value + exact[i].per_reflectance);
        let tolerance = rounding + conditioning + f64::from(f32::MIN_POSITIVE);
        let error = (f64::from(found) - exact[i].value).abs();
        assert!(
            error <= tolerance || tolerance > 0.1 * exact[i].value,
            "{bsdf:?}, {wo} {wi}: {found} ± {tolerance:e} for {:?}",
            exact[i]
        );
        [f64::from(found), error, tolerance]
    });
    value
}

/// The same pair of directions seen from the other one, and the factor between the two values without their cosines. Below
/// the surface everything is turned over and the index inverted; radiance over the square of the index is what stays.
fn seen_back(bsdf: &Bsdf, wo: Vec3, wi: Vec3) -> (Bsdf, Vec3, Vec3, f64) {
    match *bsdf {
        Bsdf::Dielectric(d) if wi.z < 0.0 => {
            let turned = Bsdf::Dielectric(Dielectric { eta: 1.0 / d.eta, ..d });
            let flip = |w: Vec3| Vec3::new(w.x, w.y, -w.z);
            (turned, flip(wi), flip(wo), f64::from(d.eta).powi(2))
        }
        _ => (*bsdf, wi, wo, 1.0),
    }
}

#[test]
fn values_and_densities_are_those_of_f64_and_reciprocal_at_every_angle() {
    /// Relative tolerance up to which a value says something.
    const WELL_CONDITIONED: f64 = 1e-3;
    #[derive(Default)]
    struct Seen {
        pairs: u32,
        well_conditioned: u32,
        error: f64,
        reciprocity: f64,
    }
    let seen = Mutex::new(Seen::default());
    let cases: Vec<Bsdf> = metals_and_glasses(&ROUGH)
        .into_iter()
        .filter(|b| !b.is_delta())
        .collect();
    for_each_in_parallel(&cases, |bsdf| {
        let mut random = Random(22);
        for (cos, i) in COSINES.into_iter().flat_map(|cos| (0..60).map(move |i| (cos, i))) {
            let wo = direction(cos, 0.7);
            // Directions that the lobe reaches, and any.
            let sample = bsdf.sample(wo, random.unit(), random.pair()).filter(|_| i % 4 != 0);
            if i % 4 != 0 && sample.is_none() {
                continue;
            }
            let wi = sample.map_or_else(|| warp::cosine_hemisphere(random.pair()), |s| s.wi);
            let [value, error, tolerance] = checked_eval(bsdf, wo, wi);
            let (turned, back_wo, back_wi, scale) = seen_back(bsdf, wo, wi);
            let [back, _, back_tolerance] = checked_eval(&turned, back_wo, back_wi);
            let mut seen = seen.lock().expect("no test has failed");
            seen.pairs += 1;
            if tolerance > WELL_CONDITIONED * value || back_tolerance > WELL_CONDITIONED * back {
                continue;
            }
            seen.well_conditioned += 1;
            seen.error = seen.error.max(error / value);
            if let Some(s) = sample {
                // The sample's own value is that of the exact direction, some roundings from `wi`; of a refracted one, the
                // rounding of the cosine that it comes from, over the square of the index.
                let own = f64::from(s.weight.g) * f64::from(s.pdf_w);
                let tolerance = 4.0 * tolerance + 4.0 * ROUNDOFF * f64::from(s.eta_squared).recip() * value;
                assert!((own - value).abs() < tolerance, "{bsdf:?}, {wo}: {s:?} for {value}");
            }
            let (value, back) = (scale * value / f64::from(wi.z.abs()), back / f64::from(wo.z));
            let difference = (value - back).abs() / back;
            assert!(
                difference < 2.0 * WELL_CONDITIONED,
                "{bsdf:?}, {wo} {wi}: {value} and {back}"
            );
            seen.reciprocity = seen.reciprocity.max(difference);
        }
    });
    let seen = seen.into_inner().expect("no test has failed");
    println!(
        "{} pairs; of {} well-conditioned ones values are off by up to {:.1e}, reciprocity by {:.1e}",
        seen.pairs, seen.well_conditioned, seen.error, seen.reciprocity
    );
    assert!(seen.pairs > 50_000 && seen.well_conditioned > 20_000);
}

/// Of `n` independent numbers in [0, 1] of this variance, the most that the mean is off, but for a probability of
/// `significance` (Maurer and Pontil 2009): rare numbers, which a standard error from the same sample does not know of,
/// are allowed for.
fn bernstein(variance: f64, n: f64, significance: f64) -> f64 {
    let log = (4.0 / significance).ln();
    (2.0 * variance * log / n).sqrt() + 7.0 / 3.0 * log / (n - 1.0)
}

#[test]
fn sampled_albedos_are_those_of_quadrature_in_f64_at_every_angle() {
    const N: usize = 40_000;
    let bsdfs = ROUGH.into_iter().flat_map(|alpha| {
        let metals = [(0.2, 3.0), (0.2, 1e3), (1.0, 0.0), (1e3, 0.0)];
        let glasses = [1.5, 4.0, 1.001].into_iter().flat_map(move |ior| glass(ior, alpha));
        metals
            .into_iter()
            .map(move |m| (metal(m, alpha), alpha))
            .chain(glasses.map(move |g| (g, alpha)))
    });
    let cases: Vec<(Bsdf, f32, f32)> = bsdfs
        .flat_map(|(bsdf, alpha)| [1.0, 0.1, 1e-3, 1e-5, 1e-7].map(|cos| (bsdf, alpha, cos)))
        .collect();
    let worst = Mutex::new((0.0, String::new()));
    for_each_in_parallel(&cases, |&(bsdf, alpha, cos)| {
        let wo = direction(cos, 0.7);
        let expected = exact::albedo(&bsdf, alpha.into(), wo.as_dvec3());
        let mut random = Random(23);
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..N {
            let sample = bsdf.sample(wo, random.unit(), random.pair());
            let energy = sample.map_or(0.0, |s| f64::from(s.weight.g) * f64::from(s.eta_squared));
            sum += energy;
            squares += energy * energy;
        }
        let n = N as f64;
        let mean = sum / n;
        let bound = bernstein((squares / n - mean * mean).max(0.0), n, 1e-3 / cases.len() as f64);
        let name = format!("{bsdf:?}, cos {cos:e}: {mean} ± {bound:.1e} for {expected}");
        // Quadrature is good to 1e-4.
        assert!((mean - expected).abs() <= bound + 1e-4, "{name}");
        let mut worst = worst.lock().expect("no test has failed");
        if (mean - expected).abs() > worst.0 {
            *worst = ((mean - expected).abs(), name);
        }
    });
    let (worst, name) = worst.into_inner().expect("no test has failed");
    println!("{} albedos, off by up to {worst:.1e} ({name})", cases.len());
}

/// The limit is not uniform: at angles as grazing as the lobe is wide, microfacets hide each other, and metal of width 1e-4
/// reflects a third less than a mirror.
#[test]
fn the_narrowest_lobe_reflects_what_a_mirror_does() {
    let mut worst = 0.0f64;
    for cos in [1.0f32, 0.7, 0.1, 0.03] {
        let wo = direction(cos, 0.7);
        for (eta, k) in METALS {
            let mirror = metal((eta, k), SMOOTH_ALPHA.next_down());
            let narrow = metal((eta, k), SMOOTH_ALPHA);
            assert!(mirror.is_delta() && !narrow.is_delta());
            let reflected = f64::from(mirror.sample(wo, 0.0, [0.5; 2]).expect("a mirror").weight.g);
            let albedo = exact::albedo(&narrow, SMOOTH_ALPHA.into(), wo.as_dvec3());
            // Spreading the cosine by α sin θ changes the reflectance by its curvature, of the order of (α / cos θ)², times a
            // logarithm for the tail; (1e-2, 0) is seen near its critical angle along the normal.
            let allowed = 10.0 * (f64::from(SMOOTH_ALPHA) / f64::from(cos)).powi(2) + 1e-5;
            assert!(
                (albedo - reflected).abs() < allowed,
                "{eta} + {k} i, cos {cos}: {albedo} for {reflected}"
            );
            worst = worst.max((albedo - reflected).abs());
        }
    }
    println!("across SMOOTH_ALPHA, reflectance jumps by up to {worst:.1e} at cosines from 0.03");
}
