//! The vertices in an order in which each comes after those it is reached from.
//!
//! Where fronts pass slantingly over triangles with wide angles (in the timed plane), two vertices may each be
//! reached partly from the other.  Such vertices are one group of the order: the strongly connected components of
//! the graph from each vertex to its parents.
//!
//! # Source
//! Tarjan 1972, Depth-first search and linear graph algorithms.

use super::way::NONE;

/// Groups of vertices, parents first.
#[derive(Clone, Debug, Default)]
pub(super) struct Order {
    /// All vertices; those of a group are neighbours.
    pub(super) vertices: Vec<u32>,
    /// First and last place, exclusive, of each group of more than one.
    pub(super) groups: Vec<[u32; 2]>,
    /// When a search met each vertex, and the earliest it leads back to; [`NONE`] before, and 0 once it is in
    /// the order.
    met: Vec<u32>,
    low: Vec<u32>,
    open: Vec<u32>,
    path: Vec<(u32, u8)>,
}

impl Order {
    /// Orders `n` vertices, each with up to two parents ([`NONE`] for none).
    pub(super) fn find(&mut self, n: usize, parents: impl Fn(u32) -> [u32; 2]) {
        self.vertices.clear();
        self.groups.clear();
        self.met.clear();
        self.met.resize(n, NONE);
        self.low.clear();
        self.low.resize(n, 0);
        let mut time = 0;
        for start in 0..n as u32 {
            if self.met[start as usize] == NONE {
                self.search(start, &mut time, &parents);
            }
        }
    }

    fn search(&mut self, start: u32, time: &mut u32, parents: &impl Fn(u32) -> [u32; 2]) {
        self.enter(start, time);
        while let Some(&(v, next)) = self.path.last() {
            if let Some(&parent) = parents(v).get(next as usize) {
                if let Some(top) = self.path.last_mut() {
                    top.1 += 1;
                }
                if parent == NONE {
                    continue;
                }
                if self.met[parent as usize] == NONE {
                    self.enter(parent, time);
                } else if self.low[parent as usize] != NONE {
                    let met = self.met[parent as usize];
                    self.low[v as usize] = self.low[v as usize].min(met);
                }
            } else {
                self.path.pop();
                self.leave(v);
            }
        }
    }

    fn enter(&mut self, v: u32, time: &mut u32) {
        self.met[v as usize] = *time;
        self.low[v as usize] = *time;
        *time += 1;
        self.open.push(v);
        self.path.push((v, 0));
    }

    /// Closes the group of `v` if it is the first of its own that was met.
    fn leave(&mut self, v: u32) {
        let low = self.low[v as usize];
        if low == self.met[v as usize] {
            let start = self.vertices.len() as u32;
            while let Some(member) = self.open.pop() {
                // in no group to come
                self.low[member as usize] = NONE;
                self.vertices.push(member);
                if member == v {
                    break;
                }
            }
            let end = self.vertices.len() as u32;
            if end - start > 1 {
                self.groups.push([start, end]);
            }
        }
        if let Some(&(child, _)) = self.path.last() {
            self.low[child as usize] = self.low[child as usize].min(low);
        }
    }

    /// Calls `visit` with the first and last place, exclusive, of every group, those of one vertex too.
    pub(super) fn each_group(&self, is_backward: bool, mut visit: impl FnMut(usize, usize)) {
        let n = self.vertices.len();
        let larger = self.groups.iter().map(|g| g.map(|place| place as usize));
        if is_backward {
            let mut end = n;
            for [start, stop] in larger.rev() {
                (stop..end).rev().for_each(|k| visit(k, k + 1));
                visit(start, stop);
                end = start;
            }
            (0..end).rev().for_each(|k| visit(k, k + 1));
        } else {
            let mut begin = 0;
            for [start, stop] in larger {
                (begin..start).for_each(|k| visit(k, k + 1));
                visit(start, stop);
                begin = stop;
            }
            (begin..n).for_each(|k| visit(k, k + 1));
        }
    }
}
