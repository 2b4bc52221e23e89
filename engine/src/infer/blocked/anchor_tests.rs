//! Where anchors are, and what lies between them.

use super::super::latent::{BlockLayout, Group, Shape};
use super::*;
use std::sync::Arc;

#[test]
fn anchors_are_far_apart_and_the_first_is_in_the_middle() {
    let points: Vec<Vec<f64>> = (0..101).map(|i| vec![f64::from(i), 0.0]).collect();
    let chosen = far_apart(&points.iter().collect::<Vec<_>>(), &[1.0, 1.0]);
    assert_eq!(chosen.len(), N_ANCHORS);
    let first: Vec<f64> = chosen.iter().map(|x| x[0]).take(3).collect();
    assert!(first == [50.0, 100.0, 0.0] || first == [50.0, 0.0, 100.0], "{first:?}");
    let gap = |a: &Vec<f64>| {
        let others = chosen.iter().filter(|b| *b != a);
        others.map(|b| (a[0] - b[0]).abs()).fold(f64::INFINITY, f64::min)
    };
    assert!(chosen.iter().all(|a| gap(a) >= 3.0), "{chosen:?}");
    // as many as there are
    let same = vec![vec![1.0]; 5];
    assert_eq!(far_apart(&same.iter().collect::<Vec<_>>(), &[1.0]), [vec![1.0]]);
}

/// Two fields at one place.
fn one_place() -> Layout {
    let block = || BlockLayout {
        n_coefficients: 1,
        mean_precision: None,
        shape: Shape::Scaled(Arc::new(vec![1.0])),
    };
    let group = Group { n_seen: 1, blocks: vec![block(), block()] };
    Layout { groups: vec![group], free_precision: vec![], outer: vec![], hyper: vec![0] }
}

fn anchor(layout: &Layout, at: f64, information: [f64; 3], centre: [f64; 2]) -> Anchor {
    let mut lookahead = StandIn::new(layout);
    let [a, b, c] = information;
    let own = &mut lookahead.groups[0];
    own.set(0, &DMatrix::from_row_slice(2, 2, &[a, b, b, c]), &DVector::from(centre.to_vec()));
    own.set_gram(&layout.groups[0]);
    Anchor {
        outer: vec![at],
        theta: centre.to_vec(),
        guide: Guide { lookahead, n_particles: 20 + 100 * at as usize },
    }
}

/// Between two anchors W and W y are means, and the covariance has the spread of the anchors' means on top. On an
/// anchor all is its own.
#[test]
fn between_anchors_a_lookahead_is_a_mean_as_wide_as_they_are_apart() {
    let layout = one_place();
    let own = [([4.0, 1.0, 2.0], [0.0, 1.0]), ([1.0, 0.0, 3.0], [2.0, -2.0])];
    let all = (0..2).map(|k| anchor(&layout, k as f64, own[k].0, own[k].1)).collect();
    let anchors = Anchors { scale: vec![0.5], all };
    let guide = anchors.at(&[0.0], &layout).unwrap();
    assert_eq!(guide.n_particles, 20);
    let (information, centre) = guide.lookahead.groups[0].at(0);
    assert!((information - DMatrix::from_row_slice(2, 2, &[4.0, 1.0, 1.0, 2.0])).norm() < 1e-6);
    assert!((centre - DVector::from_row_slice(&[0.0, 1.0])).norm() < 1e-6);

    // in the middle both count alike
    let guide = anchors.at(&[0.5], &layout).unwrap();
    assert_eq!(guide.n_particles, 70);
    let (information, centre) = guide.lookahead.groups[0].at(0);
    let mean = DMatrix::from_row_slice(2, 2, &[2.5, 0.5, 0.5, 2.5]);
    // (W y of both)/2: W₀ y₀ = (1, 2), W₁ y₁ = (2, −6)
    let pull = DVector::from_row_slice(&[1.5, -2.0]);
    assert!((&mean * &centre - pull).norm() < 1e-9);
    let apart = DVector::from_row_slice(&[1.0, -1.5]);
    let wide = mean.try_inverse().unwrap() + &apart * apart.transpose();
    assert!((information.try_inverse().unwrap() - wide).norm() < 1e-9);
    // and what is known of the modes goes with it
    let gram = |f, g| guide.lookahead.groups[0].gram(f, g)[0];
    let information = |f, g| guide.lookahead.groups[0].information(f, g)[0];
    assert!((0..4).all(|k| (gram(k / 2, k % 2) - information(k / 2, k % 2)).abs() < 1e-12));
}
