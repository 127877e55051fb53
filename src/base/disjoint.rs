//! Disjoint sets of the numbers 0..n, joined pair by pair.

/// Each set is represented by its smallest number.
pub struct DisjointSets {
    parent: Vec<u32>,
}

impl DisjointSets {
    /// Puts each of the numbers, at most 2³², into a set of its own.
    pub fn new(count: usize) -> DisjointSets {
        DisjointSets { parent: (0..count as u32).collect() }
    }

    /// The smallest number of the set that holds `of`.
    pub fn root(&mut self, mut of: u32) -> u32 {
        while self.parent[of as usize] != of {
            let above = self.parent[self.parent[of as usize] as usize];
            self.parent[of as usize] = above;
            of = above;
        }
        of
    }

    pub fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joined_numbers_have_the_smallest_as_their_root() {
        let mut sets = DisjointSets::new(6);
        for (a, b) in [(5, 3), (3, 4), (1, 2)] {
            sets.join(a, b);
        }
        assert_eq!([0, 1, 2, 3, 4, 5].map(|number| sets.root(number)), [0, 1, 1, 3, 3, 3]);
    }
}
