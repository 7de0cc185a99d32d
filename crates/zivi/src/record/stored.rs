//! Motions as plain numbers, for storing them and for sending them to another process: what all
//! kinds have in common.
//!
//! ```text
//! stored  [ format, kind, length,  the numbers of the kind ]
//! ```
//!
//! `length` is how many numbers there are in all. Counts are below 2^53 and exact. Whoever changes
//! what the numbers mean raises [`FORMAT`]. All formats before are read as well: 3 to 6 have the same header,
//! before that each kind had formats of its own, followed directly by its numbers.

use std::fmt;

/// Version of the meaning of the numbers and other contents of files.
pub const FORMAT: u32 = 7;

/// The formats before with the same header.
const SAME_HEADER: [f64; 4] = [3.0, 4.0, 5.0, 6.0];

/// Whose motion is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoredKind {
    /// A mass above a wall.
    Point = 1,
    /// A mechanical system.
    Mechanism = 2,
}

impl StoredKind {
    const ALL: [Self; 2] = [Self::Point, Self::Mechanism];

    fn number(self) -> f64 {
        f64::from(self as u8)
    }

    /// Its formats of its own.
    fn before(self) -> &'static [f64] {
        match self {
            Self::Point => &[1.0, 2.0],
            Self::Mechanism => &[1.0],
        }
    }
}

impl fmt::Display for StoredKind {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::Point => "a mass above a wall",
            Self::Mechanism => "a mechanical system",
        })
    }
}

/// Why numbers are no motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MotionError {
    /// They are of another version of this library, which used this format.
    Format(f64),
    /// They are the motion of something else.
    Kind(StoredKind),
    /// They do not fit together.
    Damaged,
}

impl fmt::Display for MotionError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Format(format) => {
                write!(out, "the stored motion has format {format}, this zivi reads {FORMAT}")
            }
            Self::Kind(kind) => write!(out, "the stored motion is that of {kind}"),
            Self::Damaged => write!(out, "the stored motion is damaged"),
        }
    }
}

impl std::error::Error for MotionError {}

/// Numbers after the header of their kind.
pub(crate) struct Writer {
    numbers: Vec<f64>,
    /// Whether there was no memory for more.
    full: bool,
}

impl Writer {
    pub(crate) fn new(kind: StoredKind) -> Self {
        Self { numbers: vec![f64::from(FORMAT), kind.number(), 0.0], full: false }
    }

    pub(crate) fn number(&mut self, number: f64) {
        self.full |= self.numbers.try_reserve(1).is_err();
        if !self.full {
            self.numbers.push(number);
        }
    }

    pub(crate) fn numbers<'a>(&mut self, numbers: impl IntoIterator<Item = &'a f64>) {
        numbers.into_iter().for_each(|number| self.number(*number));
    }

    pub(crate) fn count(&mut self, count: usize) {
        self.number(count as f64);
    }

    pub(crate) fn flag(&mut self, flag: bool) {
        self.number(f64::from(u8::from(flag)));
    }

    /// The numbers; `None` where they did not fit into memory.
    pub(crate) fn finish(mut self) -> Option<Vec<f64>> {
        self.numbers[2] = self.numbers.len() as f64;
        (!self.full).then_some(self.numbers)
    }
}

/// Remaining stored numbers; `None` where they do not fit together.
pub(crate) struct Reader<'n> {
    rest: &'n [f64],
    format: f64,
}

impl<'n> Reader<'n> {
    /// Applies `of` to all numbers after the header of a kind.
    pub(crate) fn read<T>(
        kind: StoredKind,
        numbers: &'n [f64],
        of: impl FnOnce(&mut Self) -> Option<T>,
    ) -> Result<T, MotionError> {
        let (format, rest) = behind_header(kind, numbers)?;
        let mut reader = Self { rest, format };
        let made = of(&mut reader).filter(|_| reader.rest.is_empty());
        made.ok_or(MotionError::Damaged)
    }

    /// The format of the numbers.
    pub(crate) fn format(&self) -> f64 {
        self.format
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.rest.is_empty()
    }

    pub(crate) fn is_finite(&self) -> bool {
        self.rest.iter().all(|number| number.is_finite())
    }

    pub(crate) fn take(&mut self, length: usize) -> Option<&'n [f64]> {
        let (head, rest) = self.rest.split_at_checked(length)?;
        self.rest = rest;
        Some(head)
    }

    pub(crate) fn row<const N: usize>(&mut self) -> Option<[f64; N]> {
        self.take(N)?.try_into().ok()
    }

    /// So many rows.
    pub(crate) fn rows<const N: usize>(&mut self, n: usize) -> Option<Vec<[f64; N]>> {
        let rows = self.take(N.checked_mul(n)?)?.chunks_exact(N);
        rows.map(|row| row.try_into().ok()).collect()
    }

    pub(crate) fn count(&mut self) -> Option<usize> {
        let [number] = self.row()?;
        as_count(number)
    }

    pub(crate) fn counts<const N: usize>(&mut self) -> Option<[usize; N]> {
        let mut counts = [0; N];
        for count in &mut counts {
            *count = self.count()?;
        }
        Some(counts)
    }

    pub(crate) fn flag(&mut self) -> Option<bool> {
        match self.count()? {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        }
    }
}

/// A number that is a count.
pub(crate) fn as_count(number: f64) -> Option<usize> {
    ((0.0..9e15).contains(&number) && number.fract() == 0.0).then_some(number as usize)
}

/// The format, and the numbers after the header.
fn behind_header(kind: StoredKind, numbers: &[f64]) -> Result<(f64, &[f64]), MotionError> {
    let (&format, rest) = numbers.split_first().ok_or(MotionError::Damaged)?;
    if kind.before().contains(&format) {
        return Ok((format, rest));
    }
    if format != f64::from(FORMAT) && !SAME_HEADER.contains(&format) {
        return Err(MotionError::Format(format));
    }
    let &[number, length, ref rest @ ..] = rest else { return Err(MotionError::Damaged) };
    match StoredKind::ALL.into_iter().find(|it| it.number() == number) {
        Some(found) if found != kind => Err(MotionError::Kind(found)),
        Some(_) if length == numbers.len() as f64 => Ok((format, rest)),
        _ => Err(MotionError::Damaged),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(kind: StoredKind) -> Vec<f64> {
        let mut writer = Writer::new(kind);
        writer.count(2);
        writer.flag(true);
        writer.numbers(&[0.5, -7.0]);
        writer.finish().unwrap()
    }

    fn read(kind: StoredKind, numbers: &[f64]) -> Result<Vec<f64>, MotionError> {
        Reader::read(kind, numbers, |it| {
            let n = it.count()?;
            it.flag()?.then(|| it.take(n).map(<[f64]>::to_vec))?
        })
    }

    #[test]
    fn what_was_written_is_read() {
        for kind in StoredKind::ALL {
            let numbers = written(kind);
            assert_eq!(numbers, [f64::from(FORMAT), kind.number(), 7.0, 2.0, 1.0, 0.5, -7.0]);
            assert_eq!(read(kind, &numbers), Ok(vec![0.5, -7.0]));
            for form in SAME_HEADER {
                let before = [&[form], &numbers[1..]].concat();
                assert_eq!(read(kind, &before), Ok(vec![0.5, -7.0]));
                let format = Reader::read(kind, &before, |it| it.take(4).map(|_| it.format()));
                assert_eq!(format, Ok(form));
            }
        }
    }

    #[test]
    fn formats_without_a_header_are_read() {
        for format in [1.0, 2.0] {
            let numbers = [format, 2.0, 1.0, 0.5, -7.0];
            assert_eq!(read(StoredKind::Point, &numbers), Ok(vec![0.5, -7.0]));
        }
        assert_eq!(read(StoredKind::Mechanism, &[1.0, 0.0, 1.0]), Ok(Vec::new()));
        let unknown = read(StoredKind::Mechanism, &[2.0, 0.0, 1.0]);
        assert_eq!(unknown, Err(MotionError::Format(2.0)));
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let whole = written(StoredKind::Point);
        for n in 0..whole.len() {
            assert_eq!(read(StoredKind::Point, &whole[..n]), Err(MotionError::Damaged), "{n}");
        }
        let other = read(StoredKind::Mechanism, &whole);
        assert_eq!(other, Err(MotionError::Kind(StoredKind::Point)));
        let wrong =
            [(1, 0.0), (1, 3.0), (2, 6.0), (2, 8.0), (3, 1.0), (3, 3.0), (3, 1.5), (4, 2.0)];
        for (k, value) in wrong {
            let mut numbers = whole.clone();
            numbers[k] = value;
            assert_eq!(
                read(StoredKind::Point, &numbers),
                Err(MotionError::Damaged),
                "{k}: {value}"
            );
        }
        let later = [8.0, 1.0, 3.0];
        assert_eq!(read(StoredKind::Point, &later), Err(MotionError::Format(8.0)));
        let message = "the stored motion has format 8, this zivi reads 7";
        assert_eq!(MotionError::Format(8.0).to_string(), message);
    }
}
