//! The files of a system or a loop in the folder of the resources.

use core::ffi::{c_char, c_int, c_void};
use std::ffi::CString;
use std::path::{Path, PathBuf};

use zivi::drive::mechanical::{GapTracker, GapTrackerSettings, MechanicalReference, Noise};
use zivi::system::dynamics::Layout;
use zivi::system::impact_law::newton_impacts;
use zivi_core::control::{Approach, Gains, TwistingTracker};
use zivi_core::Restitution;

use super::compiled::{CompiledSystem, Function, Inputs, LoopSystem};
use super::given::{LoadedLoop, LoopController, Sizes};
use super::tree::Numbers;
use super::tree::ParametricTree;

/// Of the numbers.
const VERSION: f64 = 3.0;

/// Reads a system or a loop; `None` for files that are missing or of another version.
pub(super) fn read(token: &[u8], resources: &[u8]) -> Option<LoadedLoop> {
    let folder = folder_of(resources)?;
    let name = std::str::from_utf8(token).ok()?;
    let is_name = |it: u8| it.is_ascii_alphanumeric() || it == b'-';
    if !token.iter().all(|it| is_name(*it)) {
        return None;
    }
    let numbers = std::fs::read(folder.join(format!("{name}.bin"))).ok()?;
    // trees need none
    let library = Library::open(&folder.join(format!("{name}{ENDING}")));
    let mut from = Numbers::of(&numbers);
    if from.one()? != VERSION {
        return None;
    }
    let [n, m, r] = [from.count()?, from.count()?, from.count()?];
    let is_controlled = from.one()? != 0.0;
    let sizes = Sizes { layout: Layout::smooth(n, m), r, is_controlled };
    let law = if is_controlled { Some(law(&mut from, (m, r))?) } else { None };
    let start = sizes.first_parameter();
    let mut values = from.many(2 * n)?;
    let plant = part(&mut from, library.as_ref(), c"plant", (start, &mut values), (n, m, r))?;
    let controller = match law {
        None => None,
        Some((law, forces)) => {
            let start = (start, &mut values);
            let believed = part(&mut from, library.as_ref(), c"model", start, (n, m, r))?;
            let reference = reference(&mut from, (n, m))?;
            Some(LoopController { believed, law, forces, reference })
        }
    };
    if !from.is_empty() {
        return None;
    }
    let (number, table) = (number_of(token), LoadedLoop::table(sizes, &values));
    let (token, layout) = (token.to_vec(), sizes.layout);
    Some(LoadedLoop { token, number, table, layout, r, plant, controller })
}

/// The controller, and the forces with which contacts are pressed.
fn law(from: &mut Numbers<'_>, (m, r): (usize, usize)) -> Option<(GapTracker, Vec<Option<f64>>)> {
    let (delay, h) = (from.count()?, from.one()?);
    let posture = (from.one()?, from.one()?);
    let learn_offsets = from.one()? != 0.0;
    let latch = from.optional(2)?.map(|it| [it[0], it[1]]);
    let limits = from.optional(2 * r)?;
    let limits = limits.map(|it| it.chunks_exact(2).map(|it| (it[0], it[1])).collect());
    let noise = Noise { deviations: [from.one()?, from.one()?], steps: [from.one()?, from.one()?] };
    let (mut trackers, mut forces) = (Vec::new(), Vec::new());
    for _ in 0..m {
        let [mu1, mu2, e, horizon, shift, force] = from.array()?;
        let (gains, wall) = (Gains::new(mu1, mu2).ok()?, Restitution::from_e(e).ok()?);
        let tracker = TwistingTracker::new(gains, h, wall, wall, Approach::Positive).ok()?;
        trackers.push(tracker.with_horizon(horizon).ok()?.with_shift(shift != 0.0));
        forces.push((!force.is_nan()).then_some(force));
    }
    let settings = GapTrackerSettings { h, posture, limits, latch, delay, learn_offsets };
    let mut law = GapTracker::new(trackers, settings);
    law.noise = noise;
    Some((law, forces))
}

/// A system: restitutions, inputs, parameters, and the tree of a tree system.
fn part(
    from: &mut Numbers<'_>,
    library: Option<&Library>,
    name: &core::ffi::CStr,
    (start, values): (usize, &mut Vec<f64>),
    (n, m, r): (usize, usize, usize),
) -> Option<CompiledSystem> {
    let laws = newton_impacts(&from.many(m)?).ok()?;
    let inputs = match from.optional(n * r)? {
        Some(matrix) => Inputs::Constant(matrix),
        None => {
            let mut other = name.to_bytes().to_vec();
            other.extend_from_slice(b"_inputs");
            Inputs::Function(library?.function(&CString::new(other).ok()?)?)
        }
    };
    let count = from.count()?;
    let parameters = (start + values.len(), count);
    let given = from.many(count)?;
    let system = match from.one()? {
        0.0 => LoopSystem::Compiled(library?.function(name)?),
        _ => LoopSystem::Tree(ParametricTree::read(from, (n, m), &given)?),
    };
    values.extend(given);
    Some(CompiledSystem { system, inputs, laws, parameters })
}

fn reference(
    from: &mut Numbers<'_>,
    (n, m): (usize, usize),
) -> Option<Option<MechanicalReference>> {
    let count = from.count()?;
    if count == 0 {
        return Some(None);
    }
    Some(Some(MechanicalReference {
        q: from.many(count * n)?,
        w: from.many(count * n)?,
        turning: from.many(count * n)?,
        gaps: from.many(count * m)?,
        rates: from.many(count * m)?,
        accelerations: from.many(count * m)?,
        sides: from.many(count * m)?,
        contacts: from.many(count * m)?.iter().map(|it| *it != 0.0).collect(),
        tasks: Vec::new(),
    }))
}

/// The state of another loop is rejected by this number (FNV).
fn number_of(token: &[u8]) -> u32 {
    token
        .iter()
        .fold(0x811c_9dc5, |hash: u32, it| (hash ^ u32::from(*it)).wrapping_mul(0x0100_0193))
}

/// A folder: a path, or a URI of one.
fn folder_of(resources: &[u8]) -> Option<PathBuf> {
    let text = std::str::from_utf8(resources).ok()?;
    let Some(uri) = text.strip_prefix("file:") else { return Some(PathBuf::from(text)) };
    let path = match uri.strip_prefix("//") {
        Some(rest) => &rest[rest.find('/')?..], // beyond the host
        None => uri,
    };
    let (mut bytes, mut left) = (Vec::new(), path.as_bytes());
    while let Some((&first, rest)) = left.split_first() {
        let hex =
            rest.get(..2).filter(|_| first == b'%').and_then(|it| std::str::from_utf8(it).ok());
        match hex.and_then(|it| u8::from_str_radix(it, 16).ok()) {
            Some(byte) => (bytes.push(byte), left = &rest[2..]).1,
            None => (bytes.push(first), left = rest).1,
        }
    }
    Some(PathBuf::from(String::from_utf8(bytes).ok()?))
}

/// A library that stays loaded.
struct Library(*mut c_void);

#[cfg(target_os = "macos")]
const ENDING: &str = ".dylib";
#[cfg(not(target_os = "macos"))]
const ENDING: &str = ".so";

extern "C" {
    fn dlopen(path: *const c_char, how: c_int) -> *mut c_void;
    fn dlsym(library: *mut c_void, name: *const c_char) -> *mut c_void;
}

/// `RTLD_NOW`.
const NOW: c_int = 2;

impl Library {
    fn open(path: &Path) -> Option<Self> {
        let path = CString::new(path.to_str()?).ok()?;
        // SAFETY: the export compiled it
        let library = unsafe { dlopen(path.as_ptr(), NOW) };
        (!library.is_null()).then_some(Self(library))
    }

    fn function(&self, name: &core::ffi::CStr) -> Option<Function> {
        // SAFETY: a library that is open
        let address = unsafe { dlsym(self.0, name.as_ptr()) };
        // SAFETY: the export gives functions of these names this signature; NULL is `None`
        unsafe { core::mem::transmute::<*mut c_void, Option<Function>>(address) }
    }
}
