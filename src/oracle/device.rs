//! An Embree device: the library, configured, with its errors and its memory watched.

use super::layout::{RTC_VERSION_MAJOR, RTC_VERSION_MINOR};
use super::{Isa, error, memory, memory::Memory};
use crate::error::{Error, Result};
use embree4_sys::{
    RTCDevice, RTCDeviceProperty as Property, rtcGetDeviceProperty, rtcNewDevice, rtcReleaseDevice,
};
use std::ffi::CString;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Embree, ready to build scenes. A clone is the same device; the last one releases it.
#[derive(Clone, Debug)]
pub struct Device {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    handle: RTCDevice,
    /// In Embree's notation.
    config: String,
    memory: Arc<Memory>,
    /// Held while a scene grows or goes, so that the memory that comes or goes is known to be its.
    building: Mutex<()>,
}

// SAFETY: Embree's functions may be called for one device from several threads at once; what
// this module adds are atomics and a mutex.
unsafe impl Send for Inner {}
// SAFETY: as above.
unsafe impl Sync for Inner {}

impl Device {
    /// Configures Embree by its own notation, such as `"threads=2,isa=avx2"`; empty for Embree's
    /// choice.
    ///
    /// Embree refuses what it cannot read or the processor cannot do, with an error; but it
    /// passes over keys that it does not know.
    pub fn new(config: &str) -> Result<Self> {
        let doing = format!("create a device with configuration `{config}`");
        let text = CString::new(config)
            .map_err(|_| Error::new("the configuration of Embree has a zero byte in it"))?;
        // SAFETY: a C string that lives during the call.
        let handle = unsafe { rtcNewDevice(text.as_ptr()) };
        if handle.is_null() {
            return Err(error::creation_error(&doing)
                .remedy("write it as in \"threads=2,isa=avx2\", or leave it empty"));
        }
        let memory = Arc::new(Memory::new());
        let inner = Inner { handle, config: config.into(), memory, building: Mutex::new(()) };
        error::listen(handle);
        // SAFETY: `inner` owns both, and ends the watch before it lets go of the memory.
        unsafe { memory::watch(handle, Arc::as_ptr(&inner.memory)) };
        error::check(handle, &doing)?;
        let device = Device { inner: Arc::new(inner) };
        device.check_version()?;
        Ok(device)
    }

    /// Struct layouts came from a header; they fit the library that was loaded only if that is
    /// of the same version.
    fn check_version(&self) -> Result<()> {
        let built = (RTC_VERSION_MAJOR as isize, RTC_VERSION_MINOR as isize);
        let loaded =
            (self.property(Property::VERSION_MAJOR), self.property(Property::VERSION_MINOR));
        if built == loaded {
            return Ok(());
        }
        Err(Error::new(format!(
            "built for Embree {}.{}, but Embree {} was loaded",
            built.0,
            built.1,
            self.version()
        ))
        .remedy("build again, or let EMBREE_DIR and the library search path agree"))
    }

    /// The loaded library's version, such as `4.3.3`.
    pub fn version(&self) -> String {
        [Property::VERSION_MAJOR, Property::VERSION_MINOR, Property::VERSION_PATCH]
            .map(|part| self.property(part).to_string())
            .join(".")
    }

    /// The instruction sets that both the processor and the installed library have, the oldest first.
    /// Embree refuses a device of any other.
    pub fn available_isas() -> Vec<Isa> {
        Isa::ALL.into_iter().filter(|isa| Device::new(isa.config()).is_ok()).collect()
    }

    /// The instruction set that Embree traces with: the one that the configuration asks for, or the
    /// newest that can be had. `None` if Embree runs on a processor that [`Isa`] does not know.
    pub fn isa(&self) -> Option<Isa> {
        let asked = |isa: &Isa| self.inner.config.split(',').any(|part| part == isa.config());
        Isa::ALL.into_iter().find(asked).or_else(|| Device::available_isas().pop())
    }

    /// Name, version and instruction set, such as `Embree 4.3.3 (AVX2)`.
    pub fn description(&self) -> String {
        match self.isa() {
            Some(isa) => format!("Embree {} ({isa})", self.version()),
            None => format!("Embree {}", self.version()),
        }
    }

    fn property(&self, property: Property) -> isize {
        // SAFETY: a live device and a property that every Embree 4 knows.
        unsafe { rtcGetDeviceProperty(self.inner.handle, property) }
    }

    /// Bytes that the device's scenes take, by Embree's own account.
    pub fn bytes(&self) -> usize {
        self.inner.memory.used()
    }

    /// From now on, a scene that would take the device beyond `bytes` fails to build.
    pub fn limit_memory(&self, bytes: usize) {
        self.inner.memory.set_limit(bytes);
    }

    pub(super) fn handle(&self) -> RTCDevice {
        self.inner.handle
    }

    /// Whether the calls in this thread since the last check went well; if not, `doing` failed.
    pub(super) fn check(&self, doing: &str) -> Result<()> {
        error::check(self.inner.handle, doing)
    }

    /// While this is held, only the holder's scene grows or goes.
    pub(super) fn building(&self) -> MutexGuard<'_, ()> {
        self.inner.building.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        // SAFETY: the handle is live and this is its only owner: scenes hold a `Device`, so they
        // are gone. Embree itself loses a reference where it runs out of memory, and the device
        // lives on; so its watch on `memory` ends first.
        unsafe {
            memory::unwatch(self.handle);
            rtcReleaseDevice(self.handle);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_version_is_that_of_the_header() {
        let device = Device::new("").unwrap();
        assert!(device.version().starts_with(&format!("{RTC_VERSION_MAJOR}.{RTC_VERSION_MINOR}.")));
    }

    #[test]
    fn every_x86_64_processor_has_the_oldest_and_the_default_is_the_newest() {
        let available = Device::available_isas();
        assert_eq!(available.first(), Some(&Isa::Sse2));
        assert!(available.is_sorted());
        assert_eq!(Device::new("").unwrap().isa(), available.last().copied());
    }

    /// Embree does not name the set, but says which packets it can trace natively: 16 rays take
    /// AVX-512, 8 take AVX, 4 take SSE.
    #[test]
    fn the_instruction_set_follows_the_configuration() {
        for isa in Device::available_isas() {
            let device = Device::new(isa.config()).unwrap();
            assert_eq!(device.isa(), Some(isa));
            let native = |width| device.property(width) != 0;
            assert!(native(Property::NATIVE_RAY4_SUPPORTED), "{isa}");
            assert_eq!(native(Property::NATIVE_RAY8_SUPPORTED), isa >= Isa::Avx, "{isa}");
            assert_eq!(native(Property::NATIVE_RAY16_SUPPORTED), isa >= Isa::Avx512, "{isa}");
        }
    }

    #[test]
    fn a_bad_configuration_is_refused_in_embrees_words() {
        let error = Device::new("threads=many").unwrap_err().to_string();
        assert!(error.contains("`threads=many`") && error.contains("RTC_ERROR_"), "{error}");
        #[cfg(embree_last_error_message)]
        assert!(error.contains("expected"), "Embree's own words are missing: {error}");
        assert!(error.contains("help: "), "{error}");
        let error = Device::new("threads=1\0").unwrap_err().to_string();
        assert!(error.contains("zero byte"), "{error}");
        // The failure leaves nothing behind for the next.
        Device::new("threads=1").unwrap();
    }
}
