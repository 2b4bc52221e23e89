//! The path data of drawings: absolute M, L, H, V and Z, relative h and v.

use tiny_skia::{Path, PathBuilder};

/// The path, `None` if nothing of it can be seen: a single point, for instance; or the data that no drawing of this
/// program has.
pub(super) fn parse(data: &str) -> Result<Option<Path>, String> {
    let unknown = || format!("d=\"{data}\"");
    let mut path = PathBuilder::new();
    let (mut x, mut y) = (0.0, 0.0);
    for (command, numbers) in commands(data) {
        let numbers = numbers.ok_or_else(unknown)?;
        match (command, numbers.as_slice()) {
            ('Z', []) => path.close(),
            ('H' | 'h', [to]) => {
                x = if command == 'h' { x + to } else { *to };
                path.line_to(x, y);
            }
            ('V' | 'v', [to]) => {
                y = if command == 'v' { y + to } else { *to };
                path.line_to(x, y);
            }
            ('M' | 'L', [to_x, to_y]) => {
                (x, y) = (*to_x, *to_y);
                if command == 'M' { path.move_to(x, y) } else { path.line_to(x, y) }
            }
            _ => return Err(unknown()),
        }
    }
    Ok(path.finish())
}

/// Letters, each with its numbers; `None` where these are no numbers.
fn commands(data: &str) -> impl Iterator<Item = (char, Option<Vec<f32>>)> {
    let begins = data.match_indices(|sign: char| sign.is_ascii_alphabetic());
    begins.map(|(at, letter)| {
        let rest = &data[at + letter.len()..];
        let end = rest.find(|sign: char| sign.is_ascii_alphabetic()).unwrap_or(rest.len());
        let numbers = rest[..end].split_whitespace().map(|number| number.parse().ok());
        (letter.chars().next().unwrap_or_default(), numbers.collect())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_read_or_refused() {
        let bounds = parse("M1 2L4 -2H6V3h-1v2Z").unwrap().unwrap().bounds();
        let sides = [bounds.left(), bounds.top(), bounds.right(), bounds.bottom()];
        assert_eq!(sides.map(f32::to_bits), [1.0_f32, -2.0, 6.0, 5.0].map(f32::to_bits));
        assert!(parse("M1 2C1 1 2 2 3 3").is_err() && parse("M1 x").is_err());
        // a line through one place
        assert!(parse("M97.5 72.0").unwrap().is_none());
    }
}
