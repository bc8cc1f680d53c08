//! Counter-based random numbers with named dimensions.
//!
//! A number depends on (seed, pixel, sample index, dimension) alone: there is no state that threads, tile order or an
//! unused feature could shift. The default is a padded (0, 2)-sequence: each named dimension pair draws from the first
//! two Sobol dimensions, with an own hashed Owen scrambling and an own shuffle of the sample index (Burley 2020,
//! "Practical Hash-based Owen Scrambling"). Any prefix whose length is a power of two is stratified, and every prefix is
//! unbiased.

/// Which random numbers to draw.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u32)]
pub enum SamplerKind {
    /// Owen-scrambled Sobol points, padded by pairs of dimensions: one sequence of the samples with even index, one of the
    /// others. The two are independent of each other, so that their difference tells the error ([`crate::error`]).
    #[default]
    Sobol,
    /// The same in one sequence of all samples, which are stratified better, but do not tell their error.
    SobolWhole,
    /// Independent uniform numbers.
    Independent,
}

impl SamplerKind {
    /// Whether the samples with even index are independent of the others.
    pub fn has_independent_halves(self) -> bool {
        self != SamplerKind::SobolWhole
    }
}

/// What a random number is used for. Each name owns one pair of dimensions per bounce, whether used or not, so that a
/// scene without a feature draws the same numbers for the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Dimension {
    /// Position within the pixel.
    Pixel,
    /// Position on the lens.
    Lens,
    /// Which emitter.
    LightChoice,
    /// Which texel of the environment.
    Texel,
    /// Where on the emitter or in the texel.
    LightPosition,
    /// Which lobe of the BSDF.
    Lobe,
    /// Where on the lobe.
    Direction,
    /// Russian roulette.
    Roulette,
    /// Passing through a partly transparent surface on the bounce ray; further surfaces take further dimensions.
    Opacity,
    /// Which of the materials of a mixture; out of the way of repeated [`Dimension::Opacity`].
    Blend = BOUNCE_STRIDE - 1,
}

/// Dimensions between two bounces. Larger than the number of names; the rest serves repeated [`Dimension::Opacity`].
const BOUNCE_STRIDE: u32 = 64;

/// The random numbers of one sample of one pixel.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sampler {
    /// Which numbers.
    pub kind: SamplerKind,
    /// Of the seed and the pixel.
    pub key: [u32; 2],
    /// Of the sample; bit-reversed, as Owen scrambling wants it, for Sobol points.
    pub index: u32,
    /// Whose dimensions come next: 0 is the camera ray and the first vertex.
    pub bounce: u32,
}

impl Sampler {
    /// The numbers of sample `index` of the pixel in column `x`, row `y` of the full image.
    #[inline(always)]
    pub fn new(kind: SamplerKind, seed: u64, x: u32, y: u32, index: u32) -> Sampler {
        let [a, b, c] = hash([seed as u32, (seed >> 32) as u32, 0x5851_F42D]);
        // In numbers rather than ways to go, as loops over columns need it.
        let halves = u32::from(kind == SamplerKind::Sobol);
        let (half, index) = (index & halves, index >> halves);
        let index = if kind == SamplerKind::Independent {
            index
        } else {
            index.reverse_bits()
        };
        let [key_0, key_1, _] = hash([a ^ x, b ^ y, c ^ half]);
        Sampler {
            kind,
            key: [key_0, key_1],
            index,
            bounce: 0,
        }
    }

    /// Moves on to the dimensions of the given bounce (0 = camera ray and first vertex).
    #[inline]
    pub fn set_bounce(&mut self, bounce: u32) {
        self.bounce = bounce;
    }

    /// Two numbers in [0, 1).
    #[inline(always)]
    pub fn get_2d(&self, dimension: Dimension) -> [f32; 2] {
        let (index, first, second) = self.keys(dimension as u32);
        match self.kind {
            SamplerKind::Sobol | SamplerKind::SobolWhole => {
                [owen(index, first), owen(pascal(index), second)].map(|x| unit_f32(x.reverse_bits()))
            }
            SamplerKind::Independent => [first, second].map(unit_f32),
        }
    }

    /// One number in [0, 1).
    #[inline(always)]
    pub fn get_1d(&self, dimension: Dimension) -> f32 {
        unit_f32(self.bits(dimension as u32)[0])
    }

    /// 64 bits for a discrete choice. The high half is stratified, the low half only refines it.
    #[inline(always)]
    pub fn get_u64(&self, dimension: Dimension) -> u64 {
        let [high, low] = self.get_bits(dimension);
        u64::from(high) << 32 | u64::from(low)
    }

    /// A number in [0, 1) for the `n`-th partly transparent surface that a ray of this bounce meets.
    #[inline]
    pub fn get_opacity(&self, n: u32) -> f32 {
        unit_f32(self.bits(Dimension::Opacity as u32 + n)[0])
    }

    /// The halves of [`Sampler::get_u64`], the high one first.
    #[inline(always)]
    pub fn get_bits(&self, dimension: Dimension) -> [u32; 2] {
        self.bits(dimension as u32)
    }

    /// 32 stratified bits, and 32 that are random for each index but not stratified.
    #[inline(always)]
    fn bits(&self, offset: u32) -> [u32; 2] {
        let (index, first, second) = self.keys(offset);
        match self.kind {
            SamplerKind::Sobol | SamplerKind::SobolWhole => {
                [owen(index, first).reverse_bits(), owen(index ^ second, second)]
            }
            SamplerKind::Independent => [first, second],
        }
    }

    /// Sobol: the shuffled index, not reversed any more, and the keys of two scramblings. Independent: the
    /// last two are the random bits.
    #[inline(always)]
    fn keys(&self, offset: u32) -> (u32, u32, u32) {
        let dimension = self.bounce.wrapping_mul(BOUNCE_STRIDE).wrapping_add(offset);
        match self.kind {
            SamplerKind::Sobol | SamplerKind::SobolWhole => {
                let [shuffle, first, second] = hash([self.key[0], self.key[1], dimension]);
                (owen(self.index, shuffle).reverse_bits(), first, second)
            }
            SamplerKind::Independent => {
                let [a, b, _] = hash([self.key[0], self.key[1], self.index]);
                let [first, second, _] = hash([a, b, dimension]);
                (self.index, first, second)
            }
        }
    }
}

/// Three random numbers of three: a hash that vector units are good at (pcg3d of Jarzynski and Olano 2020).
#[inline(always)]
fn hash([x, y, z]: [u32; 3]) -> [u32; 3] {
    let mix = |[mut x, mut y, mut z]: [u32; 3]| {
        x = x.wrapping_add(y.wrapping_mul(z));
        y = y.wrapping_add(z.wrapping_mul(x));
        z = z.wrapping_add(x.wrapping_mul(y));
        [x, y, z]
    };
    let spread = [x, y, z].map(|v| v.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    mix(mix(spread).map(|v| v ^ (v >> 16)))
}

/// Owen scrambling of a bit-reversed number: each bit is flipped by a hash of the bits below it (Laine and Karras 2011,
/// in the form with better constants that Burley 2020 points to).
#[inline(always)]
fn owen(mut x: u32, seed: u32) -> u32 {
    x ^= x.wrapping_mul(0x3D20_ADEA);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6C56);
    x ^= x.wrapping_mul(0x53A2_2864);
    x
}

/// The second Sobol dimension of an index, bit-reversed. Its generator matrix is Pascal's triangle modulo 2: digit `j` is
/// the exclusive or of the index bits `k` whose binary digits include those of `j`, five masked shifts.
#[inline(always)]
fn pascal(mut x: u32) -> u32 {
    x ^= (x >> 1) & 0x5555_5555;
    x ^= (x >> 2) & 0x3333_3333;
    x ^= (x >> 4) & 0x0F0F_0F0F;
    x ^= (x >> 8) & 0x00FF_00FF;
    x ^= (x >> 16) & 0x0000_FFFF;
    x
}

/// The 24 high bits as a float in [0, 1): never 1.
#[inline(always)]
fn unit_f32(bits: u32) -> f32 {
    // By way of a signed number, which every vector unit converts.
    (bits >> 8) as i32 as f32 * (1.0 / 16_777_216.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_second_dimension_follows_the_sobol_direction_numbers() {
        for index in (0u32..4096).chain([0xDEAD_BEEF, u32::MAX]) {
            let (mut expected, mut direction) = (0u32, 1u32 << 31);
            for k in 0..32 {
                if index >> k & 1 == 1 {
                    expected ^= direction;
                }
                direction ^= direction >> 1;
            }
            assert_eq!(pascal(index).reverse_bits(), expected, "index {index}");
        }
    }

    #[test]
    fn every_elementary_interval_holds_one_point_of_a_power_of_two_prefix() {
        // Of all samples, of the even ones, of the odd ones.
        for (kind, first, stride) in [
            (SamplerKind::SobolWhole, 0, 1),
            (SamplerKind::Sobol, 0, 2),
            (SamplerKind::Sobol, 1, 2),
        ] {
            for log_n in [2, 4, 7, 10] {
                let n = 1u32 << log_n;
                for (x, y, seed, dimension) in [(0, 0, 0, Dimension::Pixel), (17, 3, 9, Dimension::Direction)] {
                    let points: Vec<[f32; 2]> = (0..n)
                        .map(|i| Sampler::new(kind, seed, x, y, first + stride * i).get_2d(dimension))
                        .collect();
                    for split in 0..=log_n {
                        let mut seen = vec![false; n as usize];
                        for [a, b] in &points {
                            let column = (a * (1u32 << split) as f32) as usize;
                            let row = (b * (1u32 << (log_n - split)) as f32) as usize;
                            let cell = row << split | column;
                            assert!(
                                !seen[cell],
                                "{kind:?}: 2^{log_n} points, {split} splits: two in one cell"
                            );
                            seen[cell] = true;
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn even_and_odd_samples_are_independent() {
        // If the two halves were stratified against each other, their means would differ less than those of independent ones;
        // so their covariance over pixels is looked at. For n pairs its standard deviation is that of the means, squared,
        // over the root of n; five of them are allowed.
        let n = 65_536u32;
        for dimension in [Dimension::Pixel, Dimension::Roulette] {
            let (mut covariance, mut variance) = (0.0, 0.0);
            for i in 0..n {
                let mean = |first: u32| {
                    let numbers = (0..4).map(|k| {
                        let sampler = Sampler::new(SamplerKind::Sobol, 7, i % 256, i / 256, first + 2 * k);
                        f64::from(sampler.get_1d(dimension)) - 0.5
                    });
                    numbers.sum::<f64>() / 4.0
                };
                let (even, odd) = (mean(0), mean(1));
                covariance += even * odd;
                variance += 0.5 * (even * even + odd * odd);
            }
            assert!(
                covariance.abs() < 5.0 * variance / f64::from(n).sqrt(),
                "{dimension:?}: {covariance} of {variance}"
            );
        }
    }

    #[test]
    fn numbers_depend_on_every_part_of_their_key_and_on_nothing_else() {
        for kind in [SamplerKind::Sobol, SamplerKind::SobolWhole, SamplerKind::Independent] {
            let base = Sampler::new(kind, 1, 2, 3, 4).get_2d(Dimension::Direction);
            assert_eq!(base, Sampler::new(kind, 1, 2, 3, 4).get_2d(Dimension::Direction));
            let mut other_bounce = Sampler::new(kind, 1, 2, 3, 4);
            other_bounce.set_bounce(1);
            for other in [
                Sampler::new(kind, 0, 2, 3, 4).get_2d(Dimension::Direction),
                Sampler::new(kind, 1, 3, 2, 4).get_2d(Dimension::Direction),
                Sampler::new(kind, 1, 2, 4, 4).get_2d(Dimension::Direction),
                Sampler::new(kind, 1, 2, 3, 5).get_2d(Dimension::Direction),
                Sampler::new(kind, 1, 2, 3, 4).get_2d(Dimension::Lobe),
                other_bounce.get_2d(Dimension::Direction),
            ] {
                assert_ne!(base, other);
            }
        }
    }

    #[test]
    fn pixels_and_dimensions_are_uncorrelated() {
        // Mean of (u - 1/2)(v - 1/2) over n pairs has standard deviation 1 / (12 sqrt n); five of them are allowed.
        for kind in [SamplerKind::Sobol, SamplerKind::SobolWhole, SamplerKind::Independent] {
            let n = 65_536u32;
            let (mut across_dimensions, mut across_pixels) = (0.0, 0.0);
            for i in 0..n {
                let a = Sampler::new(kind, 5, i % 256, i / 256, 3);
                let b = Sampler::new(kind, 5, i % 256 + 1, i / 256, 3);
                let centred = |u: f32| f64::from(u) - 0.5;
                let u = centred(a.get_1d(Dimension::Roulette));
                across_dimensions += u * centred(a.get_1d(Dimension::Lobe));
                across_pixels += u * centred(b.get_1d(Dimension::Roulette));
            }
            let bound = 5.0 / (12.0 * f64::from(n).sqrt());
            assert!((across_dimensions / f64::from(n)).abs() < bound, "{kind:?}: dimensions");
            assert!((across_pixels / f64::from(n)).abs() < bound, "{kind:?}: pixels");
        }
    }
}
