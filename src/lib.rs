//! isolux is a radiosity renderer for triangle meshes with diffuse materials: it solves the radiosity
//! equation on the patches of a scene with its own ray tracer and shows the solution as pictures.
//!
//! A program that draws a picture:
//!
//! ```no_run
//! use isolux::{Document, Frame, Settings, Solution, Tracer};
//!
//! fn main() -> isolux::Result<()> {
//!     let document = Document::open("scenes/cornell-box.toml")?;
//!     let scene = document.scene()?;
//!     let tracer = Tracer::build(&scene);
//!     let light = Solution::solve(&document, &scene, &tracer, &Settings::default(), &())?;
//!     light.save("cornell.light")?;
//!     let frame = Frame::new(512, 512);
//!     let picture = light.gathered().draw(&tracer, &light.camera, &frame, &())?;
//!     picture.save("cornell.png", light.exposure(&picture))
//! }
//! ```
//!
//! # The walk of a run
//!
//! ```text
//! arguments → scene → patches → hierarchy → form factors → solution → irradiance field → picture → file
//! ```
//!
//! # The layers
//!
//! Lower layers never name higher ones.
//!
//! | layer | module | holds |
//! | --- | --- | --- |
//! | 0 | [`error`] | errors that the user can fix: file, line, cause, remedy |
//! | 1 | [`settings`] | what a user can ask for: flags, `[patches]` and `[light]`, programs |
//! | 1 | [`progress`] | the progress of a computation, and a way to stop it |
//! | 1 | [`color`], [`sampling`] | linear RGB; seeded points and their maps |
//! | 1 | `memory`, `simd`, `known` | memory free and used; the instruction set; what is found once |
//! | 2 | [`geometry`] | rays, triangles, both intersection kernels, the [`RayCaster`] trait |
//! | 3 | [`scene`] | OBJ, glTF, PLY, STL; the TOML description; materials, textures, camera, topology |
//! | 4 | [`patches`], [`bvh`] | midpoint subdivision as arithmetic, clusters; the eight-wide SIMD hierarchy |
//! | 5 | `oracle` (feature `embree`) | Embree: device, scene under construction, committed scene |
//! | 5 | [`verify`] | exact referee, derived bounds, verdicts, adversarial rays |
//! | 5 | [`form_factor`], `coverage` | pairwise and hemispherical estimates behind [`Transport`]; what is covered |
//! | 6 | [`light`], [`direct`] | sources of light behind [`Light`]; what arrives straight from them |
//! | 6 | [`solver`] | Jacobi, Gauss–Seidel, Southwell |
//! | 7 | [`radiosity`] | form factors, direct light, solution and energy balance in one call |
//! | 7 | [`begun`] | what is done of it, to be gone on with |
//! | 8 | [`solution`] | the light of a scene with the scene: owned, saved as a `.light` file |
//! | 7 | `paths` | paths of light, which end by chance or where a solution is known |
//! | 8 | [`certificate`] | how far a solution is from the truth, at most |
//! | 8 | [`field`] | irradiance at any point, behind [`IrradianceField`]: constant, interpolated, path-traced |
//! | 8 | [`render`], `export` | pictures by fields or by gathering, exposure; files that appear whole |
//! | 8 | `lit_sides`, `framing` | sides that light reaches; a camera for scenes without one |
//! | 8 | [`two_level`] | light on very many patches, gathered from fewer, whole or in parts |
//! | 9 | [`plan`] | from a scene and its settings to its solution |
//! | 9 | [`view`] | a solution, ready to be drawn from anywhere |
//! | 9 | [`equivalence`] | the whole pipeline on two tracers, every difference explained |
//! | 9 | `bench` | rays per second beside Embree's, on scenes made in memory |
//! | 10 | [`cli`] | one file per subcommand |
//!
//! # Decisions
//!
//! - **Rays hit triangles, never patches.** The patch under a hit follows from the hit's barycentrics by
//!   arithmetic ([`patches::Cell`]), so the hierarchy is as small as the mesh however fine the patches.
//! - **Radiance in and out.** `Ke` is emitted radiance L (W·sr⁻¹·m⁻²), `Kd` is diffuse reflectance ρ,
//!   exitance is E = πL, and pictures show L = B/π. A picture therefore compares without a factor with
//!   that of any physically based renderer.
//! - **Both sides reflect, the front emits.** The front is where a triangle is counter-clockwise. A model
//!   whose winding is turned round needs no help. Sides that no light reaches (`lit_sides`) have no patches.
//! - **f32 geometry, f64 sums, no absolute epsilon.** A ray's origin is lifted off its surface by what
//!   rounding can do to it ([`geometry::Triangle::ray_offset`]), so scaling the scene by a power of two
//!   changes nothing. Sample points keep that distance from their patch's rim
//!   ([`patches::Side::sampling_area`]), because rounding could put them behind the next wall.
//! - **The same bits everywhere.** Random numbers are functions of (seed, purpose, index), and sums have a
//!   fixed order. The kernels fuse and approximate nothing, so AVX-512, AVX2 and SSE2 agree.
//! - **Small lamps are sampled separately.** Few of a patch's rays find a small lamp, so its light is
//!   estimated by [`direct`] and the rays carry only what is reflected.
//! - **Work follows light, not triangles.** Small triangles share patches (`patches::cluster`), and pictures gather
//!   soft light from the patches at the pixels (`render::gather`), so neither the patches nor the triangles show.
//! - **Millions of patches gather.** Their light is read from some 20,000 elements by paths that are not stored, so a
//!   patch takes 42 bytes and its light depends on no other patch ([`two_level`]).
//! - **Near pairs are sampled by solid angle.** 1/r² has no finite variance over two patches that share
//!   an edge; sampled by solid angle (`form_factor::spherical`) the integrand is a bounded cosine.
//! - **Covered parts do not count.** A patch that is partly covered by another surface is weighted by its
//!   uncovered part (`coverage`), so no dark triangles appear at the feet of blocks.
//! - **One surface per place.** Of triangles that overlap in one plane one is seen, by a rule and not by rounding
//!   ([`scene::overlaps`]); the wrapper that applies it to every caster also lets rays through openings
//!   ([`bvh::Surfaces`]).
//! - **Every ray can be checked.** [`verify`] traces ordinary and adversarial rays with the native tracer
//!   and its peers. An exact referee settles each difference, within error bounds that are derived.
//! - **No seam leaks.** Where rounding hides on which side of an edge a ray passes, the side is decided
//!   exactly ([`geometry::moller_trumbore::intersect_seam`]).
//!
//! # Further reading
//!
//! In the repository, `docs/method.md` states the equation and the choice of methods,
//! `docs/verification.md` shows how the ray tracer is checked, and `docs/performance.md` holds what was
//! measured and which optimisations helped.
//!
//! [`RayCaster`]: geometry::RayCaster
//! [`Light`]: light::Light
//! [`Transport`]: form_factor::Transport
//! [`IrradianceField`]: field::IrradianceField

pub mod balance;
pub mod begun;
mod bench;
pub mod bvh;
pub mod certificate;
pub mod cli;
pub mod color;
mod coverage;
pub mod direct;
pub mod equivalence;
pub mod error;
mod export;
pub mod field;
pub mod form_factor;
mod framing;
pub mod geometry;
mod known;
mod layers;
pub mod light;
mod lit_sides;
mod memory;
#[cfg(feature = "embree")]
pub mod oracle;
mod patch_errors;
pub mod patches;
mod paths;
pub mod plan;
pub mod progress;
pub mod radiosity;
pub mod render;
pub mod sampling;
pub mod scene;
pub mod settings;
mod simd;
pub mod solution;
pub mod solver;
pub mod two_level;
pub mod verify;
pub mod view;

pub use bvh::Tracer;
pub use error::{Error, ErrorKind, Result};
pub use geometry::RayCaster;
pub use plan::Plan;
pub use progress::{Progress, Stage};
pub use render::{Frame, Image};
pub use scene::{Camera, Document, Scene};
pub use settings::Settings;
pub use solution::Solution;
pub use view::View;
