//! Disjoint sets that are joined bit by bit: union-find with path halving (Tarjan & van Leeuwen,
//! 1984).

/// The members 0 to n − 1 in groups. At first each is a group of its own.
pub(crate) struct Groups {
    /// For each member another one of its group, nearer to the root, which names itself.
    parent: Vec<usize>,
}

impl Groups {
    pub(crate) fn new(count: usize) -> Self {
        Groups { parent: (0..count).collect() }
    }

    /// The member that stands for the group, which is the lowest.
    pub(crate) fn root(&mut self, mut member: usize) -> usize {
        while self.parent[member] != member {
            self.parent[member] = self.parent[self.parent[member]];
            member = self.parent[member];
        }
        member
    }

    pub(crate) fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b)] = a.min(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lowest_member_stands_for_a_group() {
        let mut groups = Groups::new(6);
        for (a, b) in [(5, 3), (4, 5), (1, 2)] {
            groups.join(a, b);
        }
        let roots: Vec<usize> = (0..6).map(|member| groups.root(member)).collect();
        assert_eq!(roots, [0, 1, 1, 3, 3, 3]);
    }
}
