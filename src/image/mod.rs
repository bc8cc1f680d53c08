//! Images in memory, their codecs and their comparison. The only pixel file I/O of the crate.

pub mod compare;
pub mod flip;

/// A row-major image; row 0 is the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Image<T> {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width * height` pixels.
    pub pixels: Vec<T>,
}

impl<T: Clone> Image<T> {
    /// An image of one value.
    pub fn filled(width: u32, height: u32, value: T) -> Image<T> {
        Image {
            width,
            height,
            pixels: vec![value; width as usize * height as usize],
        }
    }
}

impl<T> Image<T> {
    /// The pixel in column `x`, row `y`.
    pub fn at(&self, x: u32, y: u32) -> &T {
        &self.pixels[y as usize * self.width as usize + x as usize]
    }
}
