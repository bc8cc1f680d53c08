//! The statements of OBJ text, and where it can be cut between two of them.

use memchr::{memchr, memrchr};

/// No sensible line is longer; without a limit a file without line ends would be read into memory whole.
pub(super) const MAX_LINE: usize = 1 << 24;

/// Walks over statements: lines, joined with those they are continued on.
pub(super) struct Statements<'a> {
    rest: &'a [u8],
    /// Number of the next line, from 1.
    next_line: u64,
    /// Number of the first line of the statement.
    line: u64,
    /// The statement, unless it has several lines.
    single: &'a [u8],
    /// The statement, if it has several lines.
    joined: Vec<u8>,
    is_joined: bool,
}

/// A statement is longer than [`MAX_LINE`].
#[derive(Debug)]
pub(super) struct TooLong;

impl<'a> Statements<'a> {
    /// Of text that begins with line `first_line` of its file.
    pub(super) fn new(text: &'a [u8], first_line: u64) -> Statements<'a> {
        Statements {
            rest: text,
            next_line: first_line,
            line: first_line,
            single: &[],
            joined: Vec::new(),
            is_joined: false,
        }
    }

    /// Goes to the next statement and returns the number of its line.
    #[inline]
    pub(super) fn advance(&mut self) -> Option<Result<u64, TooLong>> {
        self.line = self.next_line;
        self.is_joined = false;
        let line = self.take_line()?;
        self.single = line.trim_ascii_end();
        if line.len() > MAX_LINE {
            self.single = &line[..64];
            return Some(Err(TooLong));
        }
        Some(if is_continued(self.single) {
            self.join().map(|()| self.line)
        } else {
            Ok(self.line)
        })
    }

    fn join(&mut self) -> Result<(), TooLong> {
        self.is_joined = true;
        self.joined.clear();
        self.joined.extend_from_slice(self.single);
        while is_continued(&self.joined) {
            self.joined.pop();
            self.joined.push(b' ');
            let Some(line) = self.take_line() else { break };
            self.joined.extend_from_slice(line);
            if self.joined.len() > MAX_LINE {
                self.joined.truncate(64);
                return Err(TooLong);
            }
            self.joined.truncate(self.joined.trim_ascii_end().len());
        }
        Ok(())
    }

    #[inline]
    fn take_line(&mut self) -> Option<&'a [u8]> {
        if self.rest.is_empty() {
            return None;
        }
        let end = memchr(b'\n', self.rest).map_or(self.rest.len(), |newline| newline + 1);
        let (line, rest) = self.rest.split_at(end);
        self.rest = rest;
        self.next_line += 1;
        Some(line)
    }

    /// The statement as it is in the file, without white space at its end.
    #[inline]
    pub(super) fn text(&self) -> &[u8] {
        if self.is_joined { &self.joined } else { self.single }
    }

    /// The statement without white space and byte-order mark before it.
    #[inline]
    pub(super) fn content(&self) -> &[u8] {
        let text = self.text();
        let text = if self.line == 1 {
            text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text)
        } else {
            text
        };
        text.trim_ascii_start()
    }

    /// Number of the line that the statement begins on.
    pub(super) fn line(&self) -> u64 {
        self.line
    }

    /// Number of the line after the statement.
    pub(super) fn next_line(&self) -> u64 {
        self.next_line
    }
}

fn is_continued(text: &[u8]) -> bool {
    text.last() == Some(&b'\\') && text.first() != Some(&b'#')
}

/// How much of `text`, which begins with a statement, is whole statements: up to a line end with no backslash before it, nor
/// before the empty lines that it may follow. If there is no such line end, there is no telling, and it is 0.
pub(super) fn whole_statements(text: &[u8]) -> usize {
    let mut end = text.len();
    while let Some(newline) = memrchr(b'\n', &text[..end]) {
        let before = text[..newline].trim_ascii_end();
        if before.last() != Some(&b'\\') {
            return newline + 1;
        }
        end = before.len() - 1;
    }
    0
}

/// How much of `text` is whole lines, or all of it.
pub(super) fn whole_lines(text: &[u8]) -> usize {
    memrchr(b'\n', text).map_or(text.len(), |newline| newline + 1)
}

/// Cuts whole statements into pieces of about `size` bytes.
pub(super) fn pieces(mut text: &[u8], size: usize) -> Vec<&[u8]> {
    let mut pieces = Vec::new();
    let mut reach = size;
    while text.len() > reach {
        match whole_statements(&text[..reach]) {
            0 => reach *= 2,
            end => {
                let (piece, rest) = text.split_at(end);
                pieces.push(piece);
                text = rest;
                reach = size;
            }
        }
    }
    pieces.push(text);
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    fn statements(text: &[u8], first_line: u64) -> Vec<(u64, Vec<u8>)> {
        let mut statements = Statements::new(text, first_line);
        let mut all = Vec::new();
        while let Some(line) = statements.advance() {
            all.push((line.unwrap(), statements.text().to_vec()));
        }
        all
    }

    #[test]
    fn text_cut_into_pieces_has_the_same_statements() {
        let mut state = 3u64;
        let mut cuts = 0;
        for _ in 0..20_000 {
            let text: Vec<u8> = (0..40)
                .map(|_| {
                    state = state
                        .wrapping_mul(6_364_136_223_846_793_005)
                        .wrapping_add(1_442_695_040_888_963_407);
                    b"av# \\\\\n\n\r\n"[(state >> 40) as usize % 10]
                })
                .collect();
            let mut line = 1;
            let mut joined = Vec::new();
            for piece in pieces(&text, 1 + (state >> 60) as usize) {
                cuts += 1;
                joined.extend(statements(piece, line));
                line += piece.iter().filter(|b| **b == b'\n').count() as u64;
            }
            assert_eq!(joined, statements(&text, 1), "{:?}", String::from_utf8_lossy(&text));
        }
        assert!(cuts > 50_000, "{cuts}");
    }
}
