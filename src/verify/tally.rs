//! Verdicts, counted.

use super::verdict::Verdict;
use serde::Serialize;

/// How many queries ended how.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Tally {
    pub queries: u64,
    pub agree: u64,
    pub tie: u64,
    pub touching: u64,
    pub precision: u64,
    pub native_wrong: u64,
    pub peer_wrong: u64,
    pub both_wrong: u64,
    /// The largest difference of t between two hits of one triangle, in ulps.
    pub largest_t_ulps: u64,
}

impl Tally {
    pub fn count(&mut self, verdict: Verdict) {
        self.queries += 1;
        *match verdict {
            Verdict::Agree => &mut self.agree,
            Verdict::Tie => &mut self.tie,
            Verdict::Touching => &mut self.touching,
            Verdict::Precision => &mut self.precision,
            Verdict::NativeWrong => &mut self.native_wrong,
            Verdict::PeerWrong => &mut self.peer_wrong,
            Verdict::BothWrong => &mut self.both_wrong,
        } += 1;
    }

    pub fn add(&mut self, other: &Tally) {
        self.queries += other.queries;
        self.agree += other.agree;
        self.tie += other.tie;
        self.touching += other.touching;
        self.precision += other.precision;
        self.native_wrong += other.native_wrong;
        self.peer_wrong += other.peer_wrong;
        self.both_wrong += other.both_wrong;
        self.largest_t_ulps = self.largest_t_ulps.max(other.largest_t_ulps);
    }

    /// Notes two distances of one triangle.
    pub fn compare_distances(&mut self, a: f32, b: f32) {
        let ulps = (a.to_bits() as i64).abs_diff(b.to_bits() as i64);
        self.largest_t_ulps = self.largest_t_ulps.max(ulps);
    }

    /// Queries in which our own answer was wrong.
    pub fn failures(&self) -> u64 {
        self.native_wrong + self.both_wrong
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_query_is_counted_once() {
        let all = [
            Verdict::Agree,
            Verdict::Tie,
            Verdict::Touching,
            Verdict::Precision,
            Verdict::NativeWrong,
            Verdict::PeerWrong,
            Verdict::BothWrong,
        ];
        let mut tally = Tally::default();
        for verdict in all {
            tally.count(verdict);
        }
        let counted = Tally {
            queries: 7,
            agree: 1,
            tie: 1,
            touching: 1,
            precision: 1,
            native_wrong: 1,
            peer_wrong: 1,
            both_wrong: 1,
            largest_t_ulps: 0,
        };
        assert_eq!(tally, counted);
        assert_eq!(tally.failures(), 2);
        tally.compare_distances(1.0, 1f32.next_up().next_up());
        let before = tally;
        tally.add(&before);
        assert_eq!((tally.queries, tally.agree, tally.largest_t_ulps), (14, 2, 2));
    }
}
