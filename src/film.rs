//! Accumulation of samples into pixels.

use crate::image::Image;
use crate::math::Rgb;
use thiserror::Error;

/// Edge length of a tile in pixels.
pub const TILE_SIZE: u32 = 16;

/// Edge length of a block in pixels: the camera rays of one sample index in a block are traced together.
const BLOCK_SIZE: u32 = 4;

/// A rectangle of pixels of the full image: columns x0..x1, rows y0..y1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rect {
    /// First column.
    pub x0: u32,
    /// First row.
    pub y0: u32,
    /// Past the last column.
    pub x1: u32,
    /// Past the last row.
    pub y1: u32,
}

impl Rect {
    /// Columns.
    pub fn width(&self) -> u32 {
        self.x1 - self.x0
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.y1 - self.y0
    }

    /// Number of pixels.
    pub fn pixels(&self) -> u64 {
        u64::from(self.width()) * u64::from(self.height())
    }

    /// The parts of this rectangle in each block of 4 x 4 pixels of the image.
    pub fn blocks(self) -> impl Iterator<Item = Rect> {
        let start = |first: u32, end: u32| (first / BLOCK_SIZE * BLOCK_SIZE..end).step_by(BLOCK_SIZE as usize);
        let rows = start(self.y0, self.y1);
        rows.flat_map(move |y| start(self.x0, self.x1).map(move |x| Rect::block(x, y).intersection(self)))
    }

    /// Squares of this edge length that cover the rectangle from its corner on, cut off at its ends; row by row.
    pub fn split(self, size: u32) -> impl Iterator<Item = Rect> {
        let rows = (self.y0..self.y1).step_by(size as usize);
        rows.flat_map(move |y0| {
            (self.x0..self.x1).step_by(size as usize).map(move |x0| Rect {
                x0,
                y0,
                x1: self.x1.min(x0.saturating_add(size)),
                y1: self.y1.min(y0.saturating_add(size)),
            })
        })
    }

    /// Column and row of every pixel, row by row.
    pub fn coordinates(self) -> impl Iterator<Item = (u32, u32)> {
        (self.y0..self.y1).flat_map(move |y| (self.x0..self.x1).map(move |x| (x, y)))
    }

    /// The block of 4 x 4 pixels around a pixel, which may reach past the image.
    pub fn block(x: u32, y: u32) -> Rect {
        let (x0, y0) = (x / BLOCK_SIZE * BLOCK_SIZE, y / BLOCK_SIZE * BLOCK_SIZE);
        Rect {
            x0,
            y0,
            x1: x0 + BLOCK_SIZE,
            y1: y0 + BLOCK_SIZE,
        }
    }

    /// What two overlapping rectangles share.
    pub fn intersection(self, other: Rect) -> Rect {
        Rect {
            x0: self.x0.max(other.x0),
            y0: self.y0.max(other.y0),
            x1: self.x1.min(other.x1),
            y1: self.y1.min(other.y1),
        }
    }
}

/// The sum of a pixel's samples and what rounding has taken from it so far (Knuth's TwoSum): right to an ulp of f64 for any
/// number of addends that a film can have, and so the same, to an ulp, in whatever order and groups they are added. A plain
/// f64 sum is not: partial films of 1e6 samples, merged in another order, differ by up to 30 ulps. One in f32 is off by 1 %
/// for 1e6 equal samples, and after one sample of 1e8 ignores everything up to 4.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Sum {
    rounded: [f64; 3],
    error: [f64; 3],
}

impl Sum {
    #[inline]
    fn add(&mut self, x: [f64; 3]) {
        for (c, x) in x.into_iter().enumerate() {
            let sum = self.rounded[c] + x;
            let from_x = sum - self.rounded[c];
            self.error[c] += (self.rounded[c] - (sum - from_x)) + (x - from_x);
            self.rounded[c] = sum;
        }
    }

    fn value(&self) -> [f64; 3] {
        [0, 1, 2].map(|c| self.rounded[c] + self.error[c])
    }

    fn merge(&mut self, other: &Sum) {
        self.add(other.rounded);
        // Too small to be rounded noticeably.
        self.error = [0, 1, 2].map(|c| self.error[c] + other.error[c]);
    }
}

/// What is kept of the samples of a pixel, 0 to some number.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelSums {
    sum: Sum,
    /// Of the samples with an even index, less that of the others. A plain sum: only an error is made of it.
    difference: [f64; 3],
    samples: u32,
    /// Whether a camera ray met an emitter or the environment.
    pub(crate) sees_light: bool,
}

impl PixelSums {
    /// Adds the next sample.
    #[inline]
    pub fn add(&mut self, radiance: Rgb) {
        let x = radiance.to_array().map(f64::from);
        self.sum.add(x);
        let sign = if self.samples.is_multiple_of(2) { 1.0 } else { -1.0 };
        self.difference = [0, 1, 2].map(|c| self.difference[c] + sign * x[c]);
        self.samples += 1;
    }

    /// Number of samples.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// Mean of the samples; black if there are none.
    pub fn mean(&self) -> [f64; 3] {
        self.sum.value().map(|s| s / f64::from(self.samples.max(1)))
    }

    /// Variance of [`PixelSums::mean`], by the difference of the means of even and odd samples, which are independent of each
    /// other ([`crate::sampling::SamplerKind::has_independent_halves`]). Unbiased, but with a single degree of freedom: good for
    /// sums over many pixels. Infinite if there are fewer than two samples.
    pub fn variance(&self) -> [f64; 3] {
        if self.samples < 2 {
            return [f64::INFINITY; 3];
        }
        let odd = f64::from(self.samples / 2);
        let even = f64::from(self.samples) - odd;
        let sum = self.sum.value();
        [0, 1, 2].map(|c| {
            let means = [
                (sum[c] + self.difference[c]) / (2.0 * even),
                (sum[c] - self.difference[c]) / (2.0 * odd),
            ];
            // Half by half, variances go by the reciprocals of the numbers of samples.
            let share = even / (even + odd) * odd / (even + odd);
            (means[0] - means[1]).powi(2) * share
        })
    }

    fn merge(&mut self, other: &PixelSums) {
        self.sum.merge(&other.sum);
        self.difference = [0, 1, 2].map(|c| self.difference[c] + other.difference[c]);
        self.samples += other.samples;
        self.sees_light |= other.sees_light;
    }
}

/// Pixels that get the same number of samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cell {
    /// Which pixels.
    pub rect: Rect,
    /// Samples that every pixel has.
    pub samples: u32,
    /// Samples that every pixel is to get, by the plan so far.
    pub goal: u32,
}

/// Part of the film, owned by one thread at a time.
///
/// Each pixel adds its samples in the order of their index, so that the sum does not depend on threads or tile order.
#[derive(Clone, Debug)]
pub struct Tile {
    /// The pixels covered.
    pub rect: Rect,
    pub(crate) cells: Vec<Cell>,
    pub(crate) pixels: TilePixels,
}

impl Tile {
    fn new(rect: Rect, cell_size: u32) -> Tile {
        let cell = |rect| Cell {
            rect,
            samples: 0,
            goal: 0,
        };
        Tile {
            rect,
            cells: rect.split(cell_size).map(cell).collect(),
            pixels: TilePixels {
                rect,
                sums: vec![PixelSums::default(); rect.pixels() as usize],
                direct: Vec::new(),
            },
        }
    }

    /// Adds the next sample to a pixel given in coordinates of the full image.
    #[inline]
    pub fn add(&mut self, x: u32, y: u32, radiance: Rgb) {
        self.pixels.at_mut(x, y).add(radiance);
    }
}

/// The pixels of a tile, row by row.
#[derive(Clone, Debug)]
pub(crate) struct TilePixels {
    rect: Rect,
    sums: Vec<PixelSums>,
    /// The direct part of each pixel; empty if it is not kept apart.
    direct: Vec<Sum>,
}

impl TilePixels {
    /// A pixel given in coordinates of the full image.
    #[inline]
    fn at(&self, x: u32, y: u32) -> &PixelSums {
        &self.sums[self.index(x, y)]
    }

    /// The same, to be changed.
    #[inline]
    pub(crate) fn at_mut(&mut self, x: u32, y: u32) -> &mut PixelSums {
        let index = self.index(x, y);
        &mut self.sums[index]
    }

    /// Adds the direct part of the next sample, in a film that keeps it apart.
    #[inline]
    pub(crate) fn add_direct(&mut self, x: u32, y: u32, radiance: Rgb) {
        let index = self.index(x, y);
        self.direct[index].add(radiance.to_array().map(f64::from));
    }

    fn index(&self, x: u32, y: u32) -> usize {
        (y - self.rect.y0) as usize * self.rect.width() as usize + (x - self.rect.x0) as usize
    }
}

/// Why films cannot be merged.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
pub enum MergeError {
    /// They are of different parts of the image.
    #[error("the films are of different parts of the image: {0:?} and {1:?}")]
    Crop(Rect, Rect),
    /// Together they have more samples than can be counted.
    #[error("a pixel would have more than 4294967295 samples")]
    Samples,
    /// One of them keeps direct light apart ([`Film::split_direct`]), the other does not.
    #[error("only one of the films keeps direct light apart")]
    Direct,
}

/// The pixels being rendered, in tiles.
#[derive(Clone, Debug)]
pub struct Film {
    crop: Rect,
    cell_size: u32,
    tiles: Vec<Tile>,
}

impl Film {
    /// An empty film for a part of the image, with cells of [`TILE_SIZE`].
    pub fn new(crop: Rect) -> Film {
        Film::with_cells(crop, TILE_SIZE)
    }

    /// One with cells of so many pixels by so many, 1 to [`TILE_SIZE`].
    pub fn with_cells(crop: Rect, cell_size: u32) -> Film {
        let tiles = crop.split(TILE_SIZE).map(|rect| Tile::new(rect, cell_size));
        Film {
            crop,
            cell_size,
            tiles: tiles.collect(),
        }
    }

    /// The same film, still empty, that keeps apart which part of the light is direct; it takes more than half as much memory
    /// again.
    pub fn split_direct(mut self) -> Film {
        for tile in &mut self.tiles {
            tile.pixels.direct = vec![Sum::default(); tile.pixels.sums.len()];
        }
        self
    }

    /// The part of the image.
    pub fn crop(&self) -> Rect {
        self.crop
    }

    /// Edge length of a cell in pixels.
    pub(crate) fn cell_size(&self) -> u32 {
        self.cell_size
    }

    /// The tiles, each to be handed to one thread.
    pub fn tiles_mut(&mut self) -> &mut [Tile] {
        &mut self.tiles
    }

    /// All cells, tile by tile.
    pub fn cells(&self) -> impl Iterator<Item = &Cell> {
        self.tiles.iter().flat_map(|tile| &tile.cells)
    }

    /// The same, with the pixels of each.
    pub(crate) fn cells_and_pixels(&self) -> impl Iterator<Item = (&Cell, impl Iterator<Item = &PixelSums>)> {
        self.tiles.iter().flat_map(|tile| {
            let of_cell = |cell: &Cell| cell.rect.coordinates().map(|(x, y)| tile.pixels.at(x, y));
            tile.cells.iter().map(move |cell| (cell, of_cell(cell)))
        })
    }

    /// The same, to be given new goals.
    pub(crate) fn cells_mut(&mut self) -> impl Iterator<Item = &mut Cell> {
        self.tiles.iter_mut().flat_map(|tile| &mut tile.cells)
    }

    /// The smallest and the largest number of samples of a pixel.
    pub fn sample_range(&self) -> (u32, u32) {
        let pixels = self.tiles.iter().flat_map(|t| &t.pixels.sums);
        pixels
            .map(PixelSums::samples)
            .fold(None, |range: Option<(u32, u32)>, n| {
                Some(range.map_or((n, n), |(least, most)| (least.min(n), most.max(n))))
            })
            .unwrap_or((0, 0))
    }

    /// Takes in the samples of another film of the same part of the image: other sample indices of the same render, or the
    /// same ones of another seed. The order in which films are merged does not show: means agree to an ulp of f64.
    ///
    /// # Errors
    /// If it is of another part of the image, one of them alone keeps direct light apart, or a pixel would have more samples
    /// than can be counted. Nothing is changed then.
    pub fn merge(&mut self, other: &Film) -> Result<(), MergeError> {
        if self.crop != other.crop {
            return Err(MergeError::Crop(self.crop, other.crop));
        }
        if self.keeps_direct() != other.keeps_direct() {
            return Err(MergeError::Direct);
        }
        let pairs = self.tiles.iter().zip(&other.tiles);
        let mut counts = pairs.flat_map(|(to, from)| to.pixels.sums.iter().zip(&from.pixels.sums));
        if counts.any(|(to, from)| to.samples.checked_add(from.samples).is_none()) {
            return Err(MergeError::Samples);
        }
        for (to, from) in self.tiles.iter_mut().zip(&other.tiles) {
            for (to, from) in to.pixels.sums.iter_mut().zip(&from.pixels.sums) {
                to.merge(from);
            }
            for (to, from) in to.pixels.direct.iter_mut().zip(&from.pixels.direct) {
                to.merge(from);
            }
            for (to, from) in to.cells.iter_mut().zip(&from.cells) {
                to.samples += from.samples;
            }
        }
        Ok(())
    }

    /// The mean of the samples of every pixel; pixels without samples are black.
    pub fn develop(&self) -> Image<Rgb> {
        self.map(|pixel| Rgb::from(pixel.mean()))
    }

    /// The same in f64, row by row.
    pub fn means(&self) -> Vec<[f64; 3]> {
        self.map(PixelSums::mean).pixels
    }

    /// What `f` makes of the direct part of every pixel's mean and of the rest; `None` if the film does not keep them apart.
    pub fn map_parts<T: Clone + Default>(&self, f: impl Fn([[f64; 3]; 2]) -> T) -> Option<Image<T>> {
        let parts = |pixels: &TilePixels, i: usize| {
            let samples = f64::from(pixels.sums[i].samples.max(1));
            let direct = pixels.direct[i].value().map(|s| s / samples);
            let all = pixels.sums[i].mean();
            [direct, [0, 1, 2].map(|c| all[c] - direct[c])]
        };
        self.keeps_direct()
            .then(|| self.gather(|pixels, i| f(parts(pixels, i))))
    }

    fn keeps_direct(&self) -> bool {
        self.tiles.iter().any(|tile| !tile.pixels.direct.is_empty())
    }

    /// What `f` makes of every pixel.
    pub fn map<T: Clone + Default>(&self, f: impl Fn(&PixelSums) -> T) -> Image<T> {
        self.gather(|pixels, i| f(&pixels.sums[i]))
    }

    /// The same of the pixels of a tile and an index into them.
    fn gather<T: Clone + Default>(&self, f: impl Fn(&TilePixels, usize) -> T) -> Image<T> {
        let mut pixels = vec![T::default(); self.crop.pixels() as usize];
        for tile in &self.tiles {
            let width = tile.rect.width() as usize;
            for row in 0..tile.rect.height() as usize {
                let y = tile.rect.y0 as usize - self.crop.y0 as usize + row;
                let start = y * self.crop.width() as usize + (tile.rect.x0 - self.crop.x0) as usize;
                for (x, pixel) in pixels[start..start + width].iter_mut().enumerate() {
                    *pixel = f(&tile.pixels, row * width + x);
                }
            }
        }
        Image {
            width: self.crop.width(),
            height: self.crop.height(),
            pixels,
        }
    }

    /// Bytes of the sums.
    pub fn memory_bytes(&self) -> usize {
        let bytes = |t: &Tile| size_of_val(&*t.pixels.sums) + size_of_val(&*t.pixels.direct) + size_of_val(&*t.cells);
        self.tiles.iter().map(bytes).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_blocks_of_a_rectangle_are_those_of_the_image_and_cover_it_once() {
        let rect = Rect {
            x0: 5,
            y0: 2,
            x1: 21,
            y1: 9,
        };
        let mut seen = Vec::new();
        for block in rect.blocks() {
            for (x, y) in block.coordinates() {
                assert_eq!(Rect::block(x, y).intersection(rect), block, "({x}, {y})");
                seen.push((y, x));
            }
        }
        seen.sort_unstable();
        assert_eq!(seen, rect.coordinates().map(|(x, y)| (y, x)).collect::<Vec<_>>());
    }

    #[test]
    fn a_cropped_film_develops_every_pixel_at_its_place() {
        let crop = Rect {
            x0: 5,
            y0: 7,
            x1: 40,
            y1: 30,
        };
        let mut film = Film::new(crop);
        for tile in film.tiles_mut() {
            let rect = tile.rect;
            for y in rect.y0..rect.y1 {
                for x in rect.x0..rect.x1 {
                    for _ in 0..2 {
                        tile.add(x, y, Rgb::new(x as f32, y as f32, 1.0));
                    }
                }
            }
        }
        let image = film.develop();
        assert_eq!((image.width, image.height), (35, 23));
        for y in 0..23 {
            for x in 0..35 {
                assert_eq!(*image.at(x, y), Rgb::new((x + 5) as f32, (y + 7) as f32, 1.0));
            }
        }
    }

    #[test]
    fn a_film_that_keeps_direct_light_apart_has_both_parts_and_others_do_not_pay_for_it() {
        let (x1, y1) = (17, 3);
        let plain = Film::new(Rect { x0: 0, y0: 0, x1, y1 });
        let mut film = plain.clone().split_direct();
        let pixels = film.crop().pixels() as usize;
        assert_eq!(
            film.memory_bytes() - plain.memory_bytes(),
            pixels * size_of::<[f64; 6]>()
        );
        for tile in film.tiles_mut() {
            for (x, y) in tile.rect.coordinates() {
                for i in 0..2 {
                    tile.add(x, y, Rgb::new(x as f32, y as f32, 3.0));
                    tile.pixels.add_direct(x, y, Rgb::new(0.0, y as f32, i as f32));
                }
            }
        }
        let mut twice = film.clone();
        assert_eq!(twice.merge(&film), Ok(()));
        for film in [&film, &twice] {
            let parts = film.map_parts(|parts| parts).unwrap();
            for (x, y) in film.crop().coordinates() {
                let (x, y, [direct, indirect]) = (f64::from(x), f64::from(y), *parts.at(x, y));
                assert_eq!((direct, indirect), ([0.0, y, 0.5], [x, 0.0, 2.5]));
            }
        }
        assert!(plain.map_parts(|parts| parts).is_none());
        assert_eq!(twice.merge(&plain), Err(MergeError::Direct));
    }

    #[test]
    fn a_million_samples_of_a_constant_average_to_it() {
        let mut film = Film::new(Rect {
            x0: 0,
            y0: 0,
            x1: 1,
            y1: 1,
        });
        let tile = &mut film.tiles_mut()[0];
        for _ in 0..1_000_000 {
            tile.add(0, 0, Rgb::splat(0.1));
        }
        assert_eq!(film.develop().at(0, 0).r, 0.1);
    }
}
