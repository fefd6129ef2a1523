//! The structs that cross the boundary, as the *installed* Embree lays them out.
//!
//! `embree4-sys` 0.0.12 carries the headers of Embree 4.2. Since 4.3 a hit has one more member,
//! `instPrimID`, where Embree was built with instance arrays, as Debian's is. With the crate's
//! `RTCRayHit` of 80 bytes, `rtcIntersect1` writes beyond its end. So `build.rs` generates these
//! structs from the installed header, and a pointer to them is cast at the call of the crate's
//! function, which passes it on unread.

/// The output of bindgen: names and contents are Embree's.
#[allow(non_camel_case_types, non_snake_case, non_upper_case_globals, missing_docs, dead_code)]
// Generated code, with Embree's own comments: nothing in it is ours to fix.
#[allow(clippy::all, rustdoc::all, unreachable_pub)]
mod installed {
    include!(concat!(env!("OUT_DIR"), "/embree.rs"));
}

pub(super) use installed::{
    RTC_VERSION_MAJOR, RTC_VERSION_MINOR, RTCHit, RTCHit4, RTCHit8, RTCHit16, RTCRay, RTCRay4,
    RTCRay8, RTCRay16, RTCRayHit, RTCRayHit4, RTCRayHit8, RTCRayHit16,
};

#[cfg(embree_last_error_message)]
pub(super) use installed::rtcGetDeviceLastErrorMessage;

/// Words of a ray: origin, tnear, direction, time, tfar, mask, id, flags.
const RAY_WORDS: usize = 12;
/// Words of a hit that every Embree 4 has: Ng, u, v, primID, geomID. Instance IDs follow them, as
/// many as Embree was built for.
const HIT_WORDS: usize = 7;

/// Checks of a struct of `$lanes` rays what Embree's code assumes of any header of version 4.
macro_rules! assert_layout {
    ($lanes:literal, $align:literal, $ray:ident, $hit:ident, $both:ident) => {
        const _: () = {
            assert!(align_of::<$ray>() == $align && align_of::<$both>() == $align);
            assert!(size_of::<$ray>() == 4 * RAY_WORDS * $lanes);
            assert!(core::mem::offset_of!($ray, tnear) == 4 * 3 * $lanes);
            assert!(core::mem::offset_of!($ray, tfar) == 4 * 8 * $lanes);
            assert!(core::mem::offset_of!($both, ray) == 0);
            assert!(core::mem::offset_of!($both, hit) == size_of::<$ray>());
            assert!(core::mem::offset_of!($hit, u) == 4 * 3 * $lanes);
            assert!(core::mem::offset_of!($hit, primID) == 4 * 5 * $lanes);
            assert!(core::mem::offset_of!($hit, geomID) == 4 * 6 * $lanes);
            assert!(core::mem::offset_of!($hit, instID) == 4 * HIT_WORDS * $lanes);
            assert!(size_of::<$both>() == size_of::<$ray>() + size_of::<$hit>());
        };
    };
}
assert_layout!(1, 16, RTCRay, RTCHit, RTCRayHit);
assert_layout!(4, 16, RTCRay4, RTCHit4, RTCRayHit4);
assert_layout!(8, 32, RTCRay8, RTCHit8, RTCRayHit8);
assert_layout!(16, 64, RTCRay16, RTCHit16, RTCRayHit16);

const _: () = assert!(RTC_VERSION_MAJOR == 4, "the oracle is written for Embree 4");

#[cfg(test)]
mod tests {
    use super::*;

    /// When this fails because both agree, the workaround has had its day: drop bindgen and this
    /// file, and use the structs of `embree4_sys`.
    #[test]
    fn embree4_sys_still_lays_a_hit_out_otherwise_than_the_installed_embree() {
        let (installed, carried) = (size_of::<RTCRayHit>(), size_of::<embree4_sys::RTCRayHit>());
        assert_eq!(carried, 80, "embree4-sys has changed its RTCRayHit");
        assert_ne!(installed, carried, "the installed Embree and embree4-sys agree");
        assert_ne!(size_of::<RTCRayHit16>(), size_of::<embree4_sys::RTCRayHit16>());
        // What precedes the difference is alike, as is what the crate's functions pass by value.
        assert_eq!(size_of::<RTCRay>(), size_of::<embree4_sys::RTCRay>());
    }
}
