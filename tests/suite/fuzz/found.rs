//! What fuzzing found, made small: the target, and an input that came to a bad end once.

pub(super) const FOUND: [(&str, &[u8]); 0] = [];
