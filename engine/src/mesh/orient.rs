//! Turns triangles so that neighbours run the same way round.

use super::{MeshError, topology};

/// Turns triangles so that neighbours run opposite ways along their edge, in each piece towards
/// the way most of them had; returns how many were turned.
///
/// # Errors
/// `NotOrientable`; then nothing is turned.
pub(super) fn orient(triangles: &mut [[u32; 3]]) -> Result<usize, MeshError> {
    let links = links(triangles);
    let mut turn: Vec<Option<bool>> = vec![None; triangles.len()];
    let mut turned = vec![];
    for start in 0..triangles.len() {
        if turn[start].is_some() {
            continue;
        }
        turn[start] = Some(false);
        let mut piece = vec![start];
        let mut next = 0;
        while let Some(&at) = piece.get(next) {
            next += 1;
            for &(other, agrees) in &links[at] {
                let wanted = turn[at].map(|turned| turned == agrees);
                if turn[other].is_none() {
                    turn[other] = wanted;
                    piece.push(other);
                } else if turn[other] != wanted {
                    return Err(MeshError::NotOrientable { triangles: [at, other] });
                }
            }
        }
        let n_turned = piece.iter().filter(|&&t| turn[t] == Some(true)).count();
        let minority = n_turned * 2 <= piece.len();
        turned.extend(piece.into_iter().filter(|&t| turn[t] == Some(minority)));
    }
    for &t in &turned {
        triangles[t].swap(1, 2);
    }
    Ok(turned.len())
}

/// For every triangle its neighbours, and whether the two already run opposite ways.
fn links(triangles: &[[u32; 3]]) -> Vec<Vec<(usize, bool)>> {
    let mut links = vec![Vec::new(); triangles.len()];
    for edge in topology::edges(&topology::sides(triangles)) {
        if let [a, b] = edge {
            let agrees = a.forward != b.forward;
            links[a.triangle as usize].push((b.triangle as usize, agrees));
            links[b.triangle as usize].push((a.triangle as usize, agrees));
        }
    }
    links
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_minority_is_turned() {
        let mut triangles = vec![[0, 1, 2], [0, 2, 3], [7, 8, 9], [7, 8, 10], [3, 2, 5], [5, 3, 6]];
        assert_eq!(orient(&mut triangles).unwrap(), 2);
        assert_eq!(triangles[..2], [[0, 1, 2], [0, 2, 3]]);
        let sides = topology::sides(&triangles);
        assert!(topology::edges(&sides).all(|e| e.len() == 1 || e[0].forward != e[1].forward));
    }

    #[test]
    fn a_moebius_band_cannot_be_oriented() {
        let mut band: Vec<[u32; 3]> = (0..5).map(|i| [i, (i + 1) % 5, (i + 2) % 5]).collect();
        let text = orient(&mut band).unwrap_err().to_string();
        assert!(text.starts_with("the surface cannot be oriented: triangles"), "{text}");
        assert!(text.ends_with("help: cut the band open in a mesh editor"), "{text}");
    }
}
