//! Disjoint sets that are joined bit by bit: union-find with path halving (Tarjan & van Leeuwen,
//! 1984).

/// The members 0 to n − 1 in groups. At first each is a group of its own.
pub(crate) struct Groups {
    /// For each member another one of its group, nearer to the root, which names itself.
    parent: Vec<u32>,
}

impl Groups {
    /// # Panics
    /// With more members than 2³².
    pub(crate) fn new(count: usize) -> Self {
        let count = u32::try_from(count).expect("members that can be numbered");
        Groups { parent: (0..count).collect() }
    }

    /// The member that stands for the group, which is the lowest.
    pub(crate) fn root(&mut self, member: usize) -> usize {
        let mut member = member as u32;
        loop {
            let above = self.parent[member as usize];
            if above == member {
                return member as usize;
            }
            let further = self.parent[above as usize];
            self.parent[member as usize] = further;
            member = further;
        }
    }

    pub(crate) fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b)] = a.min(b) as u32;
    }

    /// The members of which `counts` is true, group by group.
    pub(crate) fn of_members(mut self, counts: impl Fn(usize) -> bool) -> Vec<Vec<u32>> {
        let mut groups: Vec<Vec<u32>> = Vec::new();
        let mut group_of_root = vec![u32::MAX; self.parent.len()];
        for member in (0..self.parent.len()).filter(|&member| counts(member)) {
            let group = &mut group_of_root[self.root(member)];
            if *group == u32::MAX {
                *group = groups.len() as u32;
                groups.push(Vec::new());
            }
            groups[*group as usize].push(member as u32);
        }
        groups
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
        let but_the_third = groups.of_members(|member| member != 3);
        assert_eq!(but_the_third, [vec![0], vec![1, 2], vec![4, 5]]);
    }
}
