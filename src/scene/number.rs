//! Numbers from bytes, as the standard library reads them, but at once where they are short and plain.

/// Powers of ten that f64 holds exactly.
const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20,
    1e21, 1e22,
];

/// A decimal number, correctly rounded; `None` if it is not one.
#[inline]
pub(super) fn decimal(text: &[u8]) -> Option<f64> {
    short_decimal(text).or_else(|| std::str::from_utf8(text).ok()?.parse().ok())
}

/// Digits with at most one point, no more than f64 and a power of ten hold exactly: their quotient is then the nearest
/// number (Clinger 1990, "How to read floating point numbers accurately").
#[inline]
fn short_decimal(text: &[u8]) -> Option<f64> {
    let (negative, digits) = match text {
        [b'-', digits @ ..] => (true, digits),
        _ => (false, text),
    };
    // One more for the point: 10^15 is below 2^53.
    if digits.len() > 16 {
        return None;
    }
    let mut mantissa = 0u64;
    let mut point = None;
    for (at, &byte) in digits.iter().enumerate() {
        let digit = byte.wrapping_sub(b'0');
        if digit < 10 {
            mantissa = mantissa * 10 + u64::from(digit);
        } else if byte == b'.' && point.is_none() {
            point = Some(at);
        } else {
            return None;
        }
    }
    let decimals = point.map_or(0, |at| digits.len() - 1 - at);
    if digits.len() == usize::from(point.is_some()) || (point.is_none() && digits.len() > 15) {
        return None;
    }
    let value = mantissa as f64 / POWERS[decimals];
    Some(if negative { -value } else { value })
}

/// A whole number; `None` if it is not one, or too large.
#[inline]
pub(super) fn whole(text: &[u8]) -> Option<i64> {
    let mut value = 0i64;
    for &byte in text {
        let digit = byte.wrapping_sub(b'0');
        if digit >= 10 || text.len() > 18 {
            return std::str::from_utf8(text).ok()?.parse().ok();
        }
        value = value * 10 + i64::from(digit);
    }
    (!text.is_empty()).then_some(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_those_of_the_standard_library_to_the_bit() {
        let mut state = 1u64;
        let mut random = |n: usize| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize % n
        };
        let mut short = 0;
        for round in 0..400_000 {
            // Mostly digits, so that many are numbers.
            let alphabet: &[u8] = if round % 2 == 0 {
                b"0123456789"
            } else {
                b"0123456789.-+einf"
            };
            let mut text: Vec<u8> = (0..random(20)).map(|_| alphabet[random(alphabet.len())]).collect();
            if random(2) == 0 && !text.is_empty() {
                text[0] = b'-';
            }
            if random(2) == 0 && !text.is_empty() {
                let at = random(text.len());
                text[at] = b'.';
            }
            let string = std::str::from_utf8(&text).unwrap();
            let bits = |v: Option<f64>| v.map(|v| if v.is_nan() { 0 } else { v.to_bits() });
            assert_eq!(bits(decimal(&text)), bits(string.parse().ok()), "{string}");
            assert_eq!(whole(&text), string.parse().ok(), "{string}");
            short += usize::from(short_decimal(&text).is_some());
        }
        assert!(short > 50_000, "{short}");
    }
}
