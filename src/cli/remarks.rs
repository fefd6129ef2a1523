//! Remarks on choices that the program made for the user.

use crate::error::Warning;
use crate::scene::{Camera, Scene};
use crate::solution::Solution;

/// Where a picture is seen from by a camera that nobody chose, and what it leaves out, if that may surprise.
pub(super) fn on_the_camera(scene: &Scene, camera: &Camera) -> Vec<Warning> {
    let Some((first, _)) = scene.views.first() else {
        return scene.main_part_warning().into_iter().collect();
    };
    let is_used = |(_, of_file): &&(String, Camera)| *camera == of_file.placed(scene.origin);
    let others = match scene.views.len() {
        1 => String::new(),
        count => format!("--view, it has {count}; or "),
    };
    match scene.views.iter().find(is_used) {
        Some((name, _)) => vec![Warning::new(format!(
            "seen by the model's camera `{name}` (another: {others}--position and --look-at)"
        ))],
        None => {
            let instead = Warning::new(format!(
                "the model's camera `{first}` is in the dark, so another is taken (that one: --view {first})"
            ));
            [Some(instead), scene.main_part_warning()].into_iter().flatten().collect()
        }
    }
}

/// Says so if most of a scene is dark.
pub(super) fn on_the_dark(solution: &Solution) -> Option<Warning> {
    let (dark, all) = (solution.patches().in_the_dark(), solution.scene().triangles.len());
    (2 * dark > all).then(|| {
        Warning::new(format!(
            "{dark} of {all} triangles lie where no light comes, as in a closed room: let something there shine \
             (--emit MATERIAL=RADIANCE)"
        ))
    })
}
