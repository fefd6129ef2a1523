//! isolux turns triangle meshes with diffuse materials into light: it solves the radiosity equation
//! on the patches of a scene with its own ray tracer and shows the solution as pictures.
//!
//! # A run is one straight walk
//!
//! ```text
//! arguments → scene → patches → hierarchy → form factors → solution → shading → picture → file
//! ```
//!
//! | layer | module | holds |
//! | --- | --- | --- |
//! | 0 | [`error`] | what the user can mend: file, line, cause, remedy |
//! | 1 | [`color`], [`sampling`], [`memory`] | linear RGB; seeded points and their maps; what fits |
//! | 2 | [`geometry`] | rays, triangles, both intersection kernels, the [`RayCaster`] seam |
//! | 3 | [`scene`] | OBJ and MTL, the TOML description, materials, camera, topology |
//! | 4 | [`patches`], [`bvh`] | midpoint subdivision as arithmetic; the eight-wide SIMD hierarchy |
//! | 5 | `oracle` (feature `embree`) | Embree: device, scene under construction, committed scene |
//! | 5 | [`verify`] | exact referee, derived bounds, verdicts, nasty rays |
//! | 5 | [`form_factor`], [`coverage`] | pairwise and hemispherical estimates, direct light; what is covered |
//! | 6 | [`solver`] | Jacobi, Gauss–Seidel, Southwell |
//! | 7 | [`radiosity`] | form factors, direct light, solution and energy balance in one call |
//! | 8 | [`render`], [`export`] | flat and smooth pictures, exposure; files that appear whole |
//! | 9 | [`equivalence`] | the whole pipeline on two tracers, every difference explained |
//! | 9 | [`mod@bench`] | rays per second beside Embree's, on scenes made in memory |
//! | 10 | [`cli`] | one file per subcommand |
//!
//! Lower layers never name higher ones.
//!
//! # Decisions
//!
//! **Rays hit triangles, never patches.** The patch under a hit follows from the hit's barycentrics
//! by arithmetic ([`patches::Cell`]), so the hierarchy is as small as the mesh however fine the light.
//!
//! **Units.** `Ke` is emitted radiance L (W·sr⁻¹·m⁻²), `Kd` is diffuse reflectance ρ. Exitance is
//! E = πL; radiosity solves B = E + ρ Σ F B; pictures show L = B/π. So a picture compares with that
//! of any physically based renderer without a factor. Triangles emit and reflect on their front, the
//! side from which they are counter-clockwise; a material may be two-sided; other backs are black.
//!
//! **f32 geometry, f64 sums.** No absolute epsilon: a ray's origin is lifted off its surface by what
//! rounding can do to it ([`geometry::Triangle::ray_offset`]), so a scale by a power of two changes
//! nothing. A sample point keeps the same distance from its patch's rim
//! ([`patches::Side::sampling_area`]): on the rim itself rounding puts it on or behind the next wall,
//! and 3 of 5·10⁷ rays left a closed cube; with the rim none did.
//!
//! **The same bits everywhere.** Random numbers are functions of (seed, purpose, index). Sums have a
//! fixed order. The kernels fuse nothing and approximate nothing, so AVX-512, AVX2 and SSE2 agree.
//!
//! **Small lamps are sampled themselves.** Few of a patch's rays find a small lamp, so its light is
//! estimated apart ([`form_factor::direct`]) and the rays carry only what is reflected. That is what
//! makes the default picture both quick and nearly free of noise: on the Cornell box, 256 rays a patch
//! and 64 points of the lamp, the relMSE against a path-traced reference is below 1e-4.
//!
//! **Near pairs are sampled by solid angle.** 1/r² has no finite variance over two patches that share
//! an edge; sampled by solid angle (`form_factor::spherical`) the integrand is a bounded cosine.
//!
//! **Every ray can be checked.** [`verify`] asks the native tracer and its peers (scalar kernels by
//! brute force; Embree with the feature `embree`) about ordinary and nasty rays and lets an exact
//! referee settle each difference; what f32 may be forgiven is derived, not guessed.
//!
//! **No seam leaks.** Plain Möller–Trumbore in f32 let 2.4 % of the rays through that were aimed at
//! the seams of a closed cube. Within the bound of its rounding the side of an edge on which a ray
//! passes is now decided exactly ([`geometry::moller_trumbore::intersect_seam`]): none. In f64, with the
//! same bits for both triangles of an edge, the signs around a vertex may still contradict each other.
//!
//! # What was measured, and what came of it
//!
//! Single runs differ by 20 % on a shared machine; the ratios are what counts.
//!
//! - The kernels must be inlined into code compiled for the instruction set. One closure between the
//!   dispatch and the traversal kept them out and cost a factor of 2.2 in the whole transport.
//! - Scrambling a Sobol point for every ray took a third of the transport. One scrambled sequence
//!   with a digital shift per stream ([`sampling::Stream`]) is as accurate (relMSE 9.4e-5 against
//!   1.07e-4) and made the transport 1.4 times as fast.
//! - Weighting by the uncovered part ([`coverage`]) takes relMSE from 9.4e-5 to 8.5e-5 and, more
//!   visibly, the dark triangles away from around lamps and the feet of blocks.
//!
//! # Where a ray's time goes
//!
//! Millions of rays a second on one thread of a Zen 4, `isolux bench`, by the profiler of samples. A ray of
//! the room that starts on a surface visits 3.8 nodes and 1.6 leaves, one of the atrium (1.6 million
//! triangles) 18.8 and 7.1. In the room a node takes 11 ns and a leaf 27, nearly all of it arithmetic: what
//! was lost to branches that nobody can foresee is won back. In the atrium a step takes half as long again:
//! memory, though each flight asks for it a turn ahead.
//!
//! | tried | expected | came |
//! | --- | --- | --- |
//! | leaves packed without padding, 44 bytes a triangle | less memory, more speed | atrium's hierarchy from 175 to 100 MB; no faster by itself |
//! | ids made ordinary numbers, where unused lanes load them | nothing | 8 instead of 12 on the Cornell box while they were denormals |
//! | 8 rays in turns, each asking for its memory before it waits | twice | atrium, incoherent, from 0.35 to 0.7; with 16 a tenth more |
//! | long thin triangles in several boxes | fewer leaves | atrium, from 15.9 to 7.7 leaves a ray, from 0.75 to 1.0 |
//! | eight close rays as a packet | twice for the camera | Cornell box from 18 to 54, room from 13 to 27 |
//! | a small scene node by node | three times | Cornell box, incoherent, from 17 to 24, segments from 19 to 36 |
//! | wide nodes at the least cost, not the largest box opened first | a tenth fewer steps | nodes from 217,561 to 95,123, steps from 29.4 to 25.4, atrium from 1.04 to 1.25 |
//! | flights at a node, at a leaf and over apart; children ordered without branches | twice in the room | room, incoherent, from 7.0 to 9.7, segments from 7.8 to 11.9; atrium from 1.25 to 1.5 |
//! | the nearest of a leaf without branches | a fifth | room, segments, from 11.9 to 13.1; incoherent nothing |
//! | a packet's beam against eight boxes, from the sixth node on | 1.5 times | atrium, camera, from 3.7 to 4.4 |
//! | lists made by compressing registers | a quarter | Cornell box, incoherent, from 24.6 to 26.5, segments from 36.0 to 39.1 |
//! | eight rays loaded as rows and turned, not number by number | a tenth | Cornell box, incoherent, from 26.7 to 32.1, segments from 39.4 to 45.7, camera from 53.4 to 56.6 |
//! | a packet done with a triangle that all its rays miss before it divides | nothing | camera, Cornell box from 56.1 to 58.7, atrium from 4.6 to 4.8 |
//! | reinsertion of a twentieth of the nodes, not of all | a tenth slower | nothing in the room, 3 % in the atrium; the build from 0.16 to 0.04 s and from 1.6 to 1.2 |
//!
//! What did not help and is not there:
//!
//! - boxes in 8-bit steps, 128 bytes a node instead of 256, expected to make the atrium 1.3 times as fast:
//!   it stayed the same, and the room fell from 9.8 to 7.0. A wall's flat box becomes a step thick, and
//!   every ray that starts on the wall enters it: 2.4 leaves a ray instead of 1.5;
//! - the beam from the root on: on the Cornell box it costs a third of the rate;
//! - copying one of two whole hits instead of choosing number by number: a loss of 12 %, since the
//!   processor waits for what was stored in pieces;
//! - 16 or 64 flights, a leaf taken to cost from 1 to 2.5 nodes, just the cache lines that a leaf has;
//! - leaving a packet when it has two or three rays left: atrium, camera, from 4.4 to 4.0 and 3.6;
//! - sorting a batch by octant and cell before it goes as packets (the same within noise); huge pages;
//!   leaves before nodes, or large boxes first, for any-hit rays; packets for incoherent rays (5.3 instead
//!   of 6.8 in the room).
//!
//! [`RayCaster`]: geometry::RayCaster

pub mod bench;
pub mod bvh;
pub mod cli;
pub mod color;
pub mod coverage;
pub mod equivalence;
pub mod error;
pub mod export;
pub mod form_factor;
pub mod geometry;
pub mod memory;
#[cfg(feature = "embree")]
pub mod oracle;
pub mod patches;
pub mod radiosity;
pub mod render;
pub mod sampling;
pub mod scene;
pub mod solver;
pub mod verify;
