//! Quantities of many lanes side by side, so that one loop over them becomes vector instructions.
//!
//! A loop `for i in 0..padded(n)` whose body reads and writes columns, calls only inlined functions, and chooses between
//! values rather than between ways to go, is compiled to instructions that serve 4, 8 or 16 lanes at once; the code of the
//! body reads as for one. Lanes past the last one in use hold numbers that nobody reads.

#![allow(
    clippy::needless_range_loop,
    reason = "a lane is read and written in many columns at once"
)]

use crate::math::{Rgb, Vec3};
use std::ops::{Index, IndexMut};

/// Lanes of a column. Enough to fill packets of rays for several bounces, and few enough that the columns of a batch of
/// paths stay in a core's own cache.
pub const LANES: usize = 256;

/// Loops cover whole multiples of this many lanes, so that none are left over for slower code.
pub const WIDTH: usize = 16;

/// One number of each lane.
#[derive(Clone, Debug)]
pub struct Column<T>([T; LANES]);

impl<T: Copy + Default> Default for Column<T> {
    fn default() -> Self {
        Column([T::default(); LANES])
    }
}

impl<T> Index<usize> for Column<T> {
    type Output = T;
    #[inline(always)]
    fn index(&self, lane: usize) -> &T {
        &self.0[lane]
    }
}

impl<T> IndexMut<usize> for Column<T> {
    #[inline(always)]
    fn index_mut(&mut self, lane: usize) -> &mut T {
        &mut self.0[lane]
    }
}

/// The end of a loop over the first `n` lanes.
#[inline(always)]
pub fn padded(n: usize) -> usize {
    n.next_multiple_of(WIDTH).min(LANES)
}

/// `N` numbers of each lane.
#[derive(Clone, Debug)]
pub struct Columns<const N: usize>([Column<f32>; N]);

impl<const N: usize> Default for Columns<N> {
    fn default() -> Self {
        Columns(std::array::from_fn(|_| Column::default()))
    }
}

impl<const N: usize> Columns<N> {
    /// The numbers of lane `i`.
    #[inline(always)]
    pub fn get(&self, i: usize) -> [f32; N] {
        std::array::from_fn(|k| self.0[k][i])
    }

    /// Replaces those of lane `i`.
    #[inline(always)]
    pub fn set(&mut self, i: usize, values: impl Into<[f32; N]>) {
        let values = values.into();
        for k in 0..N {
            self.0[k][i] = values[k];
        }
    }

    /// Makes lane `to` like lane `from`.
    #[inline(always)]
    pub fn copy(&mut self, from: usize, to: usize) {
        for column in &mut self.0 {
            column[to] = column[from];
        }
    }
}

impl Columns<3> {
    /// Lane `i` as a vector.
    #[inline(always)]
    pub fn vec3(&self, i: usize) -> Vec3 {
        Vec3::from_array(self.get(i))
    }

    /// Lane `i` as a colour.
    #[inline(always)]
    pub fn rgb(&self, i: usize) -> Rgb {
        Rgb::from(self.get(i))
    }
}
