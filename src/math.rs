//! Vectors, colours, frames and the constants of the renderer.

use std::ops::{Add, AddAssign, Div, Index, Mul, MulAssign, Sub};

pub use glam::{Affine2, DAffine3, DMat3, DMat4, DQuat, DVec3, Mat2, Vec2, Vec3};

/// Linear Rec. 709 red, green, blue: radiance [W·m⁻²·sr⁻¹] or a reflectance in [0, 1], as the name says.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rgb {
    /// Red.
    pub r: f32,
    /// Green.
    pub g: f32,
    /// Blue.
    pub b: f32,
}

impl Rgb {
    /// All channels zero.
    pub const BLACK: Rgb = Rgb::splat(0.0);
    /// All channels one.
    pub const WHITE: Rgb = Rgb::splat(1.0);

    /// From channels.
    #[inline(always)]
    pub const fn new(r: f32, g: f32, b: f32) -> Rgb {
        Rgb { r, g, b }
    }

    /// The same value in every channel.
    #[inline(always)]
    pub const fn splat(v: f32) -> Rgb {
        Rgb { r: v, g: v, b: v }
    }

    /// Rec. 709 luminance.
    #[inline(always)]
    pub fn luminance(self) -> f32 {
        0.2126 * self.r + 0.7152 * self.g + 0.0722 * self.b
    }

    /// The largest channel.
    #[inline(always)]
    pub fn max_component(self) -> f32 {
        self.r.max(self.g).max(self.b)
    }

    /// True if no channel is above zero.
    #[inline(always)]
    pub fn is_black(self) -> bool {
        self.max_component() <= 0.0
    }

    /// True if every channel is finite.
    #[inline(always)]
    pub fn is_finite(self) -> bool {
        self.r.is_finite() && self.g.is_finite() && self.b.is_finite()
    }

    /// Applies `f` to each channel.
    #[inline(always)]
    pub fn map(self, f: impl Fn(f32) -> f32) -> Rgb {
        Rgb::new(f(self.r), f(self.g), f(self.b))
    }

    /// Linear interpolation: `self` at 0, `other` at 1.
    #[inline(always)]
    pub fn lerp(self, other: Rgb, t: f32) -> Rgb {
        self * (1.0 - t) + other * t
    }

    /// The channels in order.
    #[inline(always)]
    pub const fn to_array(self) -> [f32; 3] {
        [self.r, self.g, self.b]
    }
}

impl From<Rgb> for [f32; 3] {
    #[inline(always)]
    fn from(rgb: Rgb) -> [f32; 3] {
        rgb.to_array()
    }
}

impl From<[f32; 3]> for Rgb {
    #[inline(always)]
    fn from([r, g, b]: [f32; 3]) -> Rgb {
        Rgb { r, g, b }
    }
}

impl From<[f64; 3]> for Rgb {
    #[inline(always)]
    fn from(v: [f64; 3]) -> Rgb {
        Rgb::from(v.map(|c| c as f32))
    }
}

impl Index<usize> for Rgb {
    type Output = f32;
    fn index(&self, channel: usize) -> &f32 {
        match channel {
            0 => &self.r,
            1 => &self.g,
            _ => &self.b,
        }
    }
}

impl Add for Rgb {
    type Output = Rgb;
    #[inline(always)]
    fn add(self, o: Rgb) -> Rgb {
        Rgb::new(self.r + o.r, self.g + o.g, self.b + o.b)
    }
}

impl Sub for Rgb {
    type Output = Rgb;
    #[inline(always)]
    fn sub(self, o: Rgb) -> Rgb {
        Rgb::new(self.r - o.r, self.g - o.g, self.b - o.b)
    }
}

impl Mul for Rgb {
    type Output = Rgb;
    #[inline(always)]
    fn mul(self, o: Rgb) -> Rgb {
        Rgb::new(self.r * o.r, self.g * o.g, self.b * o.b)
    }
}

impl Mul<f32> for Rgb {
    type Output = Rgb;
    #[inline(always)]
    fn mul(self, s: f32) -> Rgb {
        Rgb::new(self.r * s, self.g * s, self.b * s)
    }
}

impl Div<f32> for Rgb {
    type Output = Rgb;
    #[inline(always)]
    fn div(self, s: f32) -> Rgb {
        Rgb::new(self.r / s, self.g / s, self.b / s)
    }
}

impl AddAssign for Rgb {
    #[inline(always)]
    fn add_assign(&mut self, o: Rgb) {
        *self = *self + o;
    }
}

impl MulAssign for Rgb {
    #[inline(always)]
    fn mul_assign(&mut self, o: Rgb) {
        *self = *self * o;
    }
}

impl MulAssign<f32> for Rgb {
    #[inline(always)]
    fn mul_assign(&mut self, s: f32) {
        *self = *self * s;
    }
}

/// An orthonormal frame whose third axis is a given unit normal (+z in local coordinates).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Local +x.
    pub s: Vec3,
    /// Local +y.
    pub t: Vec3,
    /// Local +z.
    pub n: Vec3,
}

impl Frame {
    /// Builds a frame around the unit vector `n`, without branches on its direction
    /// (Duff et al. 2017, "Building an orthonormal basis, revisited").
    #[inline(always)]
    pub fn from_normal(n: Vec3) -> Frame {
        let sign = 1f32.copysign(n.z);
        let a = -1.0 / (sign + n.z);
        let b = n.x * n.y * a;
        Frame {
            s: Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
            t: Vec3::new(b, sign + n.y * n.y * a, -n.y),
            n,
        }
    }

    /// World to local.
    #[inline(always)]
    pub fn to_local(&self, v: Vec3) -> Vec3 {
        Vec3::new(v.dot(self.s), v.dot(self.t), v.dot(self.n))
    }

    /// Local to world.
    #[inline(always)]
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.s * v.x + self.t * v.y + self.n * v.z
    }
}

/// The largest integer not above `x`, for |x| below 2²². By rounding in the mantissa: vector units lack a conversion that
/// saturates as Rust's does, and the library's function is a call.
#[inline(always)]
pub fn floor(x: f32) -> i32 {
    /// 1.5 · 2²³: the sum with it has no bits left for fractions.
    const SHIFT: f32 = 12_582_912.0;
    let shifted = x + SHIFT;
    let nearest = shifted.to_bits().wrapping_sub(SHIFT.to_bits()) as i32;
    nearest - i32::from(shifted - SHIFT > x)
}

/// The same in f64, for |x| below 2³¹.
#[inline(always)]
pub fn floor_f64(x: f64) -> i32 {
    /// 1.5 · 2⁵²; its low bits are those of 0.
    const SHIFT: f64 = 6_755_399_441_055_744.0;
    let shifted = x + SHIFT;
    shifted.to_bits() as i32 - i32::from(shifted - SHIFT > x)
}

/// Sine and cosine of an angle in turns, for |x| below a million. To 2e-7, in line and without branches, where the
/// library's are calls; a whole number of quarter turns is exact.
#[inline(always)]
pub fn sin_cos_turns(x: f32) -> (f32, f32) {
    let quarter = floor(4.0 * x + 0.5);
    let (sin, cos) = sin_cos_eighth(x - 0.25 * quarter as f32);
    // A quarter turn swaps them: blended by weights of 0 and 1, which is exact.
    let odd = (quarter & 1) as f32;
    let even = 1.0 - odd;
    let (sin, cos) = (sin * even + cos * odd, cos * even + sin * odd);
    let negate = |x: f32, quarter: i32| f32::from_bits(x.to_bits() ^ ((quarter as u32 & 2) << 30));
    (negate(sin, quarter), negate(cos, quarter.wrapping_add(1)))
}

/// [`sin_cos_turns`] for at most an eighth of a turn, either way: the series up to the ninth power.
#[inline(always)]
pub fn sin_cos_eighth(x: f32) -> (f32, f32) {
    let x = std::f32::consts::TAU * x;
    let x2 = x * x;
    let sin = x * (1.0 - x2 * (1.0 / 6.0 - x2 * (1.0 / 120.0 - x2 * (1.0 / 5040.0 - x2 * (1.0 / 362_880.0)))));
    let cos = 1.0 - x2 * (0.5 - x2 * (1.0 / 24.0 - x2 * (1.0 / 720.0 - x2 * (1.0 / 40_320.0))));
    (sin, cos)
}

/// The angle of the point (x, y) in turns, in [-1/2, 1/2]; 0 for the origin. To 5e-8 of a turn, in line and without
/// branches.
#[inline(always)]
pub fn atan2_turns(y: f32, x: f32) -> f32 {
    const TAN_EIGHTH_OF_PI: f32 = 0.414_213_56;
    /// The series of the arc tangent, fitted to the interval: off by less than 5e-9 before rounding.
    const ATAN: [f32; 4] = [0.333_327_57, 0.199_718_79, 0.138_244_51, 0.079_025_91];
    let (small, large) = (x.abs().min(y.abs()), x.abs().max(y.abs()));
    // atan(r) = π/4 + atan((r − 1) / (r + 1)) brings the argument within tan(π/8), where the series is short.
    let near_diagonal = f32::from(small > TAN_EIGHTH_OF_PI * large);
    let r = (small - large * near_diagonal) / (large + small * near_diagonal).max(f32::MIN_POSITIVE);
    let r2 = r * r;
    let series = r * (1.0 - r2 * (ATAN[0] - r2 * (ATAN[1] - r2 * (ATAN[2] - r2 * ATAN[3]))));
    let angle = series * std::f32::consts::FRAC_1_PI * 0.5 + 0.125 * near_diagonal;
    let steep = f32::from(y.abs() > x.abs());
    let angle = 0.25 * steep + angle * (1.0 - 2.0 * steep);
    let behind = f32::from(x < 0.0);
    (0.5 * behind + angle * (1.0 - 2.0 * behind)).copysign(y)
}

/// The sRGB transfer function: linear [0, 1] to encoded [0, 1] (IEC 61966-2-1).
pub fn srgb_encode(linear: f32) -> f32 {
    if linear <= 0.003_130_8 {
        12.92 * linear
    } else {
        1.055 * linear.powf(1.0 / 2.4) - 0.055
    }
}

/// The inverse of [`srgb_encode`].
pub fn srgb_decode(encoded: f32) -> f32 {
    if encoded <= 0.040_45 {
        encoded / 12.92
    } else {
        ((encoded + 0.055) / 1.055).powf(2.4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_orthonormal_for_normals_in_every_octant_and_on_the_axes() {
        for i in 0..27 {
            let v = Vec3::new((i % 3) as f32 - 1.0, (i / 3 % 3) as f32 - 1.0, (i / 9) as f32 - 1.0);
            if v == Vec3::ZERO {
                continue;
            }
            let f = Frame::from_normal(v.normalize());
            for (a, b, expected) in [
                (f.s, f.t, 0.0),
                (f.s, f.n, 0.0),
                (f.t, f.n, 0.0),
                (f.s, f.s, 1.0),
                (f.t, f.t, 1.0),
            ] {
                assert!((a.dot(b) - expected).abs() < 1e-6, "{v}: {f:?}");
            }
            assert!((f.s.cross(f.t) - f.n).length() < 1e-6, "{v}: not right-handed");
        }
    }

    #[test]
    fn floors_are_those_of_the_library() {
        for i in -1_000_000..=1_000_000 {
            for x in [
                i as f32 * 4.194_303,
                i as f32 * 1e-5,
                (i as f32).next_up(),
                (i as f32).next_down(),
            ] {
                assert_eq!(floor(x), x.floor() as i32, "{x}");
                let y = f64::from(x) * 500.0;
                assert_eq!(floor_f64(y), y.floor() as i32, "{y}");
            }
        }
    }

    #[test]
    fn sine_and_cosine_of_turns_are_those_of_f64() {
        for i in -100_000..=100_000 {
            let x = i as f32 * 2.3e-5;
            let (sin, cos) = sin_cos_turns(x);
            let (exact_sin, exact_cos) = (std::f64::consts::TAU * f64::from(x)).sin_cos();
            assert!((f64::from(sin) - exact_sin).abs() < 2e-7, "sin {x}: {sin}");
            assert!((f64::from(cos) - exact_cos).abs() < 2e-7, "cos {x}: {cos}");
        }
        for (x, expected) in [
            (0.0, (0.0, 1.0)),
            (0.25, (1.0, 0.0)),
            (0.5, (0.0, -1.0)),
            (-0.25, (-1.0, 0.0)),
        ] {
            assert_eq!(sin_cos_turns(x), expected, "{x}");
        }
    }

    #[test]
    fn the_angle_in_turns_is_that_of_f64() {
        for scale in [1e-30f32, 1e-3, 1.0, 1e30] {
            for i in 0..100_000 {
                let angle = (f64::from(i) - 50_000.0) * 1e-5 * std::f64::consts::TAU;
                let (y, x) = (scale * angle.sin() as f32, scale * angle.cos() as f32);
                let exact = f64::from(y).atan2(f64::from(x)) / std::f64::consts::TAU;
                let got = atan2_turns(y, x);
                assert!(
                    (f64::from(got) - exact).abs() < 5e-8,
                    "atan2({y}, {x}): {got} for {exact}"
                );
            }
        }
        assert_eq!(atan2_turns(0.0, 0.0), 0.0);
        assert_eq!([atan2_turns(0.0, -1.0), atan2_turns(-0.0, -1.0)], [0.5, -0.5]);
    }

    #[test]
    fn srgb_decode_inverts_srgb_encode() {
        for i in 0..=1000 {
            let x = i as f32 / 1000.0;
            assert!((srgb_decode(srgb_encode(x)) - x).abs() < 1e-5, "{x}");
        }
    }
}
