//! The numbers that follow the header, row by row.

use super::header::{Type, excerpt};
use crate::scene::number::decimal;
use memchr::memchr;

/// What is wrong with a row.
pub(super) type Fault = String;

/// Reads numbers in the order of the header.
pub(super) trait Rows {
    /// Goes to the next row.
    fn begin(&mut self) -> Result<(), Fault>;
    /// The next number of the row.
    fn number(&mut self, kind: Type) -> Result<f64, Fault>;
    /// Passes numbers of the row.
    fn skip(&mut self, kind: Type, count: usize) -> Result<(), Fault>;
    /// Ends the row.
    fn end(&mut self) -> Result<(), Fault>;
    /// The most numbers that the row may still have.
    fn most(&self, kind: Type) -> usize;
    /// Bytes that are not read.
    fn rest(&self) -> &[u8];
    /// Where the row is, for people.
    fn place(&self) -> String;
}

/// Binary numbers; big-endian ones if `BIG`.
pub(super) struct Binary<'a, const BIG: bool> {
    pub(super) bytes: &'a [u8],
    pub(super) at: usize,
    /// Where the row begins.
    pub(super) row: usize,
}

const ENDS: &str = "the file ends before the row does; it was cut, or the header's counts or types are wrong";

impl<const BIG: bool> Binary<'_, BIG> {
    #[inline(always)]
    fn take<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let Some(&bytes) = self.bytes[self.at..].first_chunk::<N>() else {
            return Err(ENDS.into());
        };
        self.at += N;
        Ok(bytes)
    }
}

macro_rules! decode {
    ($rows:expr, $kind:ty) => {{
        let bytes = $rows.take()?;
        (if BIG {
            <$kind>::from_be_bytes(bytes)
        } else {
            <$kind>::from_le_bytes(bytes)
        }) as f64
    }};
}

impl<const BIG: bool> Rows for Binary<'_, BIG> {
    #[inline(always)]
    fn begin(&mut self) -> Result<(), Fault> {
        self.row = self.at;
        Ok(())
    }

    #[inline(always)]
    fn number(&mut self, kind: Type) -> Result<f64, Fault> {
        Ok(match kind {
            Type::I8 => decode!(self, i8),
            Type::U8 => decode!(self, u8),
            Type::I16 => decode!(self, i16),
            Type::U16 => decode!(self, u16),
            Type::I32 => decode!(self, i32),
            Type::U32 => decode!(self, u32),
            Type::I64 => decode!(self, i64),
            Type::U64 => decode!(self, u64),
            Type::F32 => decode!(self, f32),
            Type::F64 => decode!(self, f64),
        })
    }

    fn skip(&mut self, kind: Type, count: usize) -> Result<(), Fault> {
        if count > self.most(kind) {
            return Err(ENDS.into());
        }
        self.at += count * kind.size();
        Ok(())
    }

    #[inline(always)]
    fn end(&mut self) -> Result<(), Fault> {
        Ok(())
    }

    fn most(&self, kind: Type) -> usize {
        (self.bytes.len() - self.at) / kind.size()
    }

    fn rest(&self) -> &[u8] {
        &self.bytes[self.at..]
    }

    fn place(&self) -> String {
        format!("byte {}", self.row)
    }
}

/// A line of text for each row.
pub(super) struct Ascii<'a> {
    pub(super) bytes: &'a [u8],
    /// Where the next line begins.
    pub(super) at: usize,
    /// Number of the next line.
    pub(super) line: u64,
    /// The last byte of a line.
    pub(super) line_end: u8,
    /// What is left of the row.
    pub(super) row: &'a [u8],
}

impl<'a> Ascii<'a> {
    #[inline(always)]
    fn word(&mut self) -> Option<&'a [u8]> {
        let start = self.row.iter().position(|b| !b.is_ascii_whitespace())?;
        let row = &self.row[start..];
        let end = row.iter().position(u8::is_ascii_whitespace).unwrap_or(row.len());
        let (word, rest) = row.split_at(end);
        self.row = rest;
        Some(word)
    }
}

impl Rows for Ascii<'_> {
    fn begin(&mut self) -> Result<(), Fault> {
        loop {
            let rest = &self.bytes[self.at..];
            if rest.is_empty() {
                return Err("the file ends before the row; it was cut, or the header's counts are wrong".into());
            }
            let end = memchr(self.line_end, rest).map_or(rest.len(), |newline| newline + 1);
            self.at += end;
            self.line += 1;
            self.row = rest[..end].trim_ascii();
            if !self.row.is_empty() {
                return Ok(());
            }
        }
    }

    #[inline(always)]
    fn number(&mut self, _: Type) -> Result<f64, Fault> {
        let Some(word) = self.word() else {
            return Err("the line has fewer numbers than the header says".into());
        };
        decimal(word).ok_or_else(|| format!("`{}` is not a number", excerpt(word)))
    }

    fn skip(&mut self, kind: Type, count: usize) -> Result<(), Fault> {
        (0..count).try_for_each(|_| self.number(kind).map(drop))
    }

    fn end(&mut self) -> Result<(), Fault> {
        if self.row.trim_ascii_start().is_empty() {
            Ok(())
        } else {
            Err("the line has more numbers than the header says".into())
        }
    }

    fn most(&self, _: Type) -> usize {
        // A digit and what parts it from the next.
        self.row.len().div_ceil(2)
    }

    fn rest(&self) -> &[u8] {
        &self.bytes[self.at..]
    }

    fn place(&self) -> String {
        format!("line {}", self.line.saturating_sub(1))
    }
}
