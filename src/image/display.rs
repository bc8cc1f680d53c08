//! From linear radiance to what a screen shows.

use super::Image;
use crate::math::{Rgb, srgb_encode};
use rayon::prelude::*;

/// Eight-bit sRGB, clamped, after a factor of 2^`exposure`. NaN is black.
pub fn to_srgb8(image: &Image<Rgb>, exposure: f32) -> Image<[u8; 3]> {
    let factor = exposure.exp2();
    // NaN passes the clamp; the cast makes it 0.
    let encode = |c: f32| (srgb_encode((c * factor).clamp(0.0, 1.0)) * 255.0 + 0.5) as u8;
    Image {
        width: image.width,
        height: image.height,
        pixels: image.pixels.par_iter().map(|p| p.to_array().map(encode)).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exposure_doubles_per_stop_and_values_are_clamped() {
        let image = Image {
            width: 3,
            height: 1,
            pixels: vec![Rgb::splat(0.25), Rgb::splat(-1.0), Rgb::splat(f32::NAN)],
        };
        assert_eq!(to_srgb8(&image, 2.0).pixels, [[255; 3], [0; 3], [0; 3]]);
        assert_eq!(to_srgb8(&image, 0.0).pixels[0], [137; 3]);
    }
}
