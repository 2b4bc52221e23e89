//! Vertices that wait for their turn, the earliest first.

use super::way::NONE;

/// Children of a node: a flat heap moves a vertex that became earlier over few levels.
const CHILDREN: usize = 4;

/// A heap in which every vertex is at most once, and may become earlier or later.
#[derive(Clone, Debug, Default)]
pub(super) struct Queue {
    nodes: Vec<(f64, u32)>,
    /// Where each vertex is among the nodes, or [`NONE`].
    places: Vec<u32>,
}

impl Queue {
    /// Empty, for `n` vertices.
    pub(super) fn clear(&mut self, n: usize) {
        self.nodes.clear();
        self.places.clear();
        self.places.resize(n, NONE);
    }

    /// Puts a vertex where its arrival belongs, be it there already or not.
    pub(super) fn put(&mut self, vertex: u32, arrival: f64) {
        let mut place = self.places[vertex as usize] as usize;
        if place == NONE as usize {
            place = self.nodes.len();
            self.nodes.push((arrival, vertex));
            self.rise(place);
        } else if arrival < self.nodes[place].0 {
            self.nodes[place].0 = arrival;
            self.rise(place);
        } else {
            self.nodes[place].0 = arrival;
            self.sink(place);
        }
    }

    /// Takes out the earliest vertex.
    pub(super) fn pop(&mut self) -> Option<u32> {
        let last = self.nodes.pop()?;
        let first = match self.nodes.first_mut() {
            None => last,
            Some(top) => std::mem::replace(top, last),
        };
        if !self.nodes.is_empty() {
            self.sink(0);
        }
        self.places[first.1 as usize] = NONE;
        Some(first.1)
    }

    fn rise(&mut self, mut place: usize) {
        let node = self.nodes[place];
        while place > 0 {
            let parent = (place - 1) / CHILDREN;
            if self.nodes[parent].0 <= node.0 {
                break;
            }
            self.set(place, self.nodes[parent]);
            place = parent;
        }
        self.set(place, node);
    }

    fn sink(&mut self, mut place: usize) {
        let node = self.nodes[place];
        loop {
            let first = CHILDREN * place + 1;
            let children = first..(first + CHILDREN).min(self.nodes.len());
            let earlier =
                |a: usize, b: usize| if self.nodes[b].0 < self.nodes[a].0 { b } else { a };
            let Some(child) = children.reduce(earlier) else { break };
            if node.0 <= self.nodes[child].0 {
                break;
            }
            self.set(place, self.nodes[child]);
            place = child;
        }
        self.set(place, node);
    }

    fn set(&mut self, place: usize, node: (f64, u32)) {
        self.nodes[place] = node;
        self.places[node.1 as usize] = place as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vertices_come_out_in_order_though_they_are_moved() {
        let mut queue = Queue::default();
        queue.clear(100);
        let key = |v: u32, k: u32| f64::from((v * 37 + k * 53) % 101);
        for k in 0..3 {
            (0..100).for_each(|v| queue.put(v, key(v, k)));
        }
        let order: Vec<u32> = std::iter::from_fn(|| queue.pop()).collect();
        assert_eq!(order.len(), 100);
        assert!(order.windows(2).all(|w| key(w[0], 2) < key(w[1], 2)), "{order:?}");
    }
}
