//! From the parts of a solution to the whole.

use super::Part;
use crate::color::Rgb64;
use crate::error::{Error, Result};
use crate::solution::Solution;

/// The solution of which these are all parts, in any order: to the bit the one that a single run finds.
///
/// # Errors
/// Parts that are missing, there twice, unfinished, or parts of different solutions.
pub fn join(mut parts: Vec<Part>) -> Result<Solution> {
    parts.sort_by_key(|part| part.share().number);
    check(&parts)?;
    let solution = put_together(parts);
    solution.check().map(|()| solution)
}

/// Joins all parts, in their order.
pub(crate) fn put_together(parts: Vec<Part>) -> Solution {
    let mut parts = parts.into_iter();
    let first = parts.next().expect("one part or more");
    let mut solution = *first.unlit.expect("the first part has it");
    let (mut light, mut rays, mut absorbed) = (first.light, first.rays, first.absorbed);
    let more = first.whole.patches as usize - light.irradiance.len();
    light.irradiance.reserve_exact(more);
    light.error.reserve_exact(more);
    light.uncovered.reserve_exact(more);
    for part in parts {
        light.irradiance.extend(part.light.irradiance);
        light.error.extend(part.light.error);
        light.uncovered.extend(part.light.uncovered);
        absorbed.extend(part.absorbed);
        rays += part.rays;
    }
    solution.light = light;
    solution.figures.rays += rays;
    solution.figures.energy.absorbed = absorbed.iter().sum::<Rgb64>();
    solution
}

/// `parts` in the order of their numbers.
fn check(parts: &[Part]) -> Result<()> {
    let Some(first) = parts.first() else {
        return Err(Error::new("there are no parts").remedy("give all parts of one solution"));
    };
    let file = |part: &Part| part.file.display().to_string();
    for part in &parts[1..] {
        let what =
            if part.whole.scene != first.whole.scene || part.whole.patches != first.whole.patches {
                "another scene, or other patches"
            } else if part.whole.choices != first.whole.choices {
                "other choices of method, or another seed"
            } else if part.whole != first.whole {
                "another camera, or elements with other light"
            } else if part.share().of != first.share().of {
                "another number of parts"
            } else {
                continue;
            };
        return Err(part
            .error(format!("this part belongs to {what} than {}", file(first)))
            .remedy("make all parts by one command, in which only --part differs"));
    }
    for pair in parts.windows(2) {
        let (one, other) = (&pair[0], &pair[1]);
        if one.share() == other.share() {
            let cause = format!("this is part {}, and so is {}", other.share(), file(one));
            return Err(other.error(cause).remedy("give each part once"));
        }
    }
    let of = first.share().of;
    let is_there = |number: &u32| parts.binary_search_by_key(number, |p| p.share().number).is_ok();
    let missing: Vec<u32> = (1..=of).filter(|number| !is_there(number)).collect();
    if let Some(number) = missing.first() {
        let cause = match missing.len() {
            1 => format!("part {number}/{of} is missing"),
            n => format!("{n} of {of} parts are missing, among them {number}/{of}"),
        };
        return Err(Error::new(cause)
            .remedy(format!("make it: isolux solve SCENE --part {number}/{of} -o NAME.part")));
    }
    match parts.iter().find(|part| !part.is_finished()) {
        Some(part) => Err(part
            .error(format!("part {} is not finished", part.share()))
            .remedy("go on with it: isolux solve with the same flags and --resume")),
        None => Ok(()),
    }
}
