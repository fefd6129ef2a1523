//! Light on very many patches, in two levels.
//!
//! Light that is exchanged is soft, and few large patches carry it well; what needs many small ones is how it arrives:
//! shadows, and the detail of near surfaces. So the radiosity equation is solved on some 20,000 *elements*, and
//! each patch then gathers its irradiance by rays of its own that read the elements' radiosity: the *local pass*
//! (Lischinski, Tampieri & Greenberg, *Combining Hierarchical Radiosity and Discontinuity Meshing*, SIGGRAPH 1993,
//! §5; Reichert, *A Two-Pass Radiosity Method Driven by Lights and Viewer Position*, 1992). No matrix is stored for
//! the patches and nothing per ray, so that a patch takes as many bytes as its light.
//!
//! The local pass of a patch asks nothing of other patches. So it can be done in [parts](Part), on as many machines
//! as there are, and be stopped and gone on with; whatever the parts, the light has the same bits.

mod elements;
mod join;
mod local_pass;
mod part;

pub(crate) use elements::Elements;
pub use join::join;
pub(crate) use join::put_together;
pub(crate) use local_pass::LocalPass;
pub use part::{Part, Share};
