//! A scene under construction, and a committed one, which alone can be traced.

use super::Device;
use crate::error::{Error, Result};
use crate::geometry::{Triangle, TriangleId};
use embree4_sys::{
    RTCBufferType, RTCBuildQuality, RTCFormat, RTCGeometry, RTCGeometryType, RTCScene,
    RTCSceneFlags, rtcAttachGeometry, rtcCommitGeometry, rtcCommitScene, rtcNewGeometry,
    rtcNewScene, rtcReleaseGeometry, rtcReleaseScene, rtcSetGeometryMask, rtcSetNewGeometryBuffer,
    rtcSetSceneBuildQuality, rtcSetSceneFlags,
};
use glam::Vec3;
use std::sync::Arc;

/// How Embree is to trace.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Options {
    /// Plücker coordinates, which do not leak at edges, in place of Embree's default
    /// Möller–Trumbore kernel (`RTC_SCENE_FLAG_ROBUST`).
    pub robust: bool,
    /// The functions that the batched methods of [`RayCaster`](crate::geometry::RayCaster) call.
    pub packets: Packets,
}

/// Rays per call: `rtcIntersect1`, `rtcIntersect4`, `rtcIntersect8` or `rtcIntersect16`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Packets {
    #[default]
    Single,
    Packet4,
    Packet8,
    Packet16,
}

/// Takes triangles until it is committed. Triangles are numbered in the order in which they come.
#[derive(Debug)]
pub struct SceneBuilder {
    content: Content,
    options: Options,
    triangles: usize,
}

/// An Embree scene with all that lives and dies with it.
#[derive(Debug)]
struct Content {
    scene: RTCScene,
    device: Device,
    /// For each geometry, the number of its first triangle.
    first_triangles: Vec<u32>,
    bytes: usize,
}

/// A committed scene: immutable, and traceable from any thread. A clone is the same scene.
#[derive(Debug, Clone)]
pub struct EmbreeScene {
    content: Arc<Content>,
    options: Options,
}

// SAFETY: after the commit nothing changes the scene, and Embree's ray queries may run on one
// committed scene from any number of threads; releasing it in another thread than the one that
// made it is allowed too.
unsafe impl Send for Content {}
// SAFETY: as above. While a scene is under construction, its builder takes `self` by value, so
// that two threads cannot change it at once.
unsafe impl Sync for Content {}

impl SceneBuilder {
    pub fn new(device: &Device, options: Options) -> Result<Self> {
        // SAFETY: a live device.
        let scene = unsafe { rtcNewScene(device.handle()) };
        device.check("create a scene")?;
        let content =
            Content { scene, device: device.clone(), first_triangles: Vec::new(), bytes: 0 };
        let flags = if options.robust { RTCSceneFlags::ROBUST } else { RTCSceneFlags::NONE };
        // SAFETY: a live scene, and settings that every Embree 4 knows. High quality builds
        // longest and traces fastest: the oracle answers far more rays than it has triangles.
        unsafe {
            rtcSetSceneFlags(scene, flags);
            rtcSetSceneBuildQuality(scene, RTCBuildQuality::HIGH);
        }
        device.check("configure a scene")?;
        Ok(SceneBuilder { content, options, triangles: 0 })
    }

    /// Adds copies of `triangles`, bit for bit.
    ///
    /// Copies, since Embree reads vertices 16 bytes at a time, beyond the last one's end, which
    /// memory shared with a `&[Triangle]` does not allow.
    pub fn add_triangles(mut self, triangles: &[Triangle]) -> Result<Self> {
        let total = self.triangles + triangles.len();
        if !fits(total) {
            return Err(Error::new(format!("{total} triangles are more than Embree can take"))
                .remedy("trace a smaller scene"));
        }
        if !triangles.is_empty() {
            self.content.grow(|content| content.attach(triangles, self.triangles as u32))?;
            self.triangles = total;
        }
        Ok(self)
    }

    /// Builds the hierarchy. Embree would accept an empty scene; here it is the likely mistake.
    pub fn commit(mut self) -> Result<EmbreeScene> {
        if self.triangles == 0 {
            return Err(Error::new("Embree has no triangles to build a scene of")
                .remedy("add triangles before the commit"));
        }
        self.content.grow(|content| {
            // SAFETY: a live scene, whose geometries are committed and attached.
            unsafe { rtcCommitScene(content.scene) };
            content.device.check("build a scene")
        })?;
        Ok(EmbreeScene { content: Arc::new(self.content), options: self.options })
    }
}

impl EmbreeScene {
    /// A scene of `triangles`; hits refer to them by index.
    pub fn build(device: &Device, triangles: &[Triangle], options: Options) -> Result<Self> {
        SceneBuilder::new(device, options)?.add_triangles(triangles)?.commit()
    }

    /// Shares this scene, with its batches traced in other packets.
    pub fn with_packets(&self, packets: Packets) -> Self {
        let options = Options { packets, ..self.options };
        EmbreeScene { content: Arc::clone(&self.content), options }
    }

    pub fn options(&self) -> Options {
        self.options
    }

    pub fn device(&self) -> &Device {
        &self.content.device
    }

    /// Memory that Embree took for this scene, including its copy of the triangles, in bytes.
    pub fn bytes(&self) -> usize {
        self.content.bytes
    }

    /// Live as long as `self`.
    pub(super) fn handle(&self) -> RTCScene {
        self.content.scene
    }

    /// The triangle that Embree calls number `primitive` of geometry `geometry`.
    pub(super) fn triangle(&self, geometry: u32, primitive: u32) -> TriangleId {
        TriangleId(self.content.first_triangles[geometry as usize] + primitive)
    }
}

/// Embree's vertex buffers end at 16 GB, and a corner's number has 32 bits.
fn fits(triangles: usize) -> bool {
    triangles <= 16_000_000_000 / size_of::<[Vec3; 3]>() && triangles <= u32::MAX as usize / 3
}

impl Content {
    /// Notes the memory that `change` takes as this scene's.
    fn grow(&mut self, change: impl FnOnce(&mut Self) -> Result<()>) -> Result<()> {
        let device = self.device.clone();
        let _alone = device.building();
        let before = device.bytes();
        change(self)?;
        self.bytes += device.bytes().saturating_sub(before);
        Ok(())
    }

    fn attach(&mut self, triangles: &[Triangle], first: u32) -> Result<()> {
        let geometry = Geometry::new(&self.device, triangles)?;
        // SAFETY: a live scene and a committed geometry of the same device. The scene keeps a
        // reference of its own.
        let id = unsafe { rtcAttachGeometry(self.scene, geometry.handle) };
        self.device.check("attach triangles to a scene")?;
        assert_eq!(id as usize, self.first_triangles.len(), "Embree counts geometries from 0");
        self.first_triangles.push(first);
        Ok(())
    }
}

impl Drop for Content {
    fn drop(&mut self) {
        let _alone = self.device.building();
        // SAFETY: the scene is live and this is its only owner.
        unsafe { rtcReleaseScene(self.scene) }
    }
}

/// A triangle mesh, owned until its scene holds it too.
struct Geometry {
    handle: RTCGeometry,
}

impl Geometry {
    /// Each triangle gets three vertices of its own, which says exactly what it is.
    fn new(device: &Device, triangles: &[Triangle]) -> Result<Self> {
        // SAFETY: a live device.
        let handle = unsafe { rtcNewGeometry(device.handle(), RTCGeometryType::TRIANGLE) };
        device.check("create a geometry")?;
        let geometry = Geometry { handle };
        let (vertex, index) = (RTCBufferType::VERTEX, RTCBufferType::INDEX);
        let corner = |i: usize| triangles[i / 3].p[i % 3];
        let corners = |i: usize| [0, 1, 2].map(|k| (3 * i + k) as u32);
        geometry.fill(device, vertex, RTCFormat::FLOAT3, 3 * triangles.len(), corner)?;
        geometry.fill(device, index, RTCFormat::UINT3, triangles.len(), corners)?;
        // SAFETY: a live geometry with its buffers filled; every ray sees every triangle.
        unsafe {
            rtcSetGeometryMask(handle, u32::MAX);
            rtcCommitGeometry(handle);
        }
        device.check("commit a geometry")?;
        Ok(geometry)
    }

    /// Writes `item(0)`, `item(1)`, ... into a new buffer of Embree's; `T` is what `format` says.
    fn fill<T>(
        &self,
        device: &Device,
        kind: RTCBufferType,
        format: RTCFormat,
        count: usize,
        item: impl Fn(usize) -> T,
    ) -> Result<()> {
        // SAFETY: a live geometry; slot 0 is the only one that a mesh without motion has.
        let buffer =
            unsafe { rtcSetNewGeometryBuffer(self.handle, kind, 0, format, size_of::<T>(), count) };
        device.check("allocate a geometry's buffer")?;
        for i in 0..count {
            // SAFETY: the allocation succeeded, so there is room for `count` of `T`, and Embree
            // aligns it to 16 bytes, which is more than a `T` of 32-bit numbers asks for.
            unsafe { buffer.cast::<T>().add(i).write(item(i)) }
        }
        Ok(())
    }
}

impl Drop for Geometry {
    fn drop(&mut self) {
        // SAFETY: the handle is live, and the reference that it stands for is ours.
        unsafe { rtcReleaseGeometry(self.handle) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle(z: f32) -> Triangle {
        Triangle::new(Vec3::new(0.0, 0.0, z), Vec3::new(1.0, 0.0, z), Vec3::new(0.0, 1.0, z))
    }

    #[test]
    fn a_scene_without_triangles_is_refused() {
        let device = Device::new("").unwrap();
        let error = SceneBuilder::new(&device, Options::default()).unwrap().commit().unwrap_err();
        assert!(error.to_string().contains("no triangles"), "{error}");
        EmbreeScene::build(&device, &[], Options::default()).unwrap_err();
    }

    #[test]
    fn too_many_triangles_are_refused_before_any_memory_is_asked_for() {
        assert!(fits(400_000_000));
        assert!(!fits(500_000_000));
    }

    #[test]
    fn running_out_of_memory_is_an_error_and_leaves_nothing_behind() {
        let device = Device::new("").unwrap();
        let triangles: Vec<Triangle> = (0..10_000).map(|i| triangle(i as f32)).collect();
        let needed = EmbreeScene::build(&device, &triangles, Options::default()).unwrap().bytes();
        // Refused at the vertices, at the hierarchy, and at places between.
        for part in 0..8 {
            device.limit_memory(needed * part / 8);
            let error = EmbreeScene::build(&device, &triangles, Options::default()).unwrap_err();
            let text = error.to_string();
            assert!(text.contains("memory monitor forced termination"), "{text}");
            assert!(text.contains("RTC_ERROR_OUT_OF_MEMORY"), "{text}");
            assert!(text.contains("help: allow Embree more memory"), "{text}");
            assert_eq!(device.bytes(), 0, "limit {} of {needed}", needed * part / 8);
        }
        device.limit_memory(usize::MAX);
        EmbreeScene::build(&device, &triangles, Options::default()).unwrap();
    }

    #[test]
    fn a_scene_knows_its_memory_and_gives_it_back() {
        let device = Device::new("").unwrap();
        let triangles: Vec<Triangle> = (0..1000).map(|i| triangle(i as f32)).collect();
        let one = EmbreeScene::build(&device, &triangles, Options::default()).unwrap();
        let two = EmbreeScene::build(&device, &triangles[..500], Options::default()).unwrap();
        // Vertices and indices at the least.
        assert!(one.bytes() >= 1000 * 48, "{} bytes", one.bytes());
        assert_eq!(device.bytes(), one.bytes() + two.bytes());
        drop(one);
        assert_eq!(device.bytes(), two.bytes());
        drop(two);
        assert_eq!(device.bytes(), 0);
    }

    #[test]
    fn a_scene_outlives_the_name_of_its_device() {
        use crate::geometry::{Ray, RayCaster};
        let device = Device::new("").unwrap();
        let scene = EmbreeScene::build(&device, &[triangle(1.0)], Options::default()).unwrap();
        drop(device);
        let ray = Ray::new(Vec3::new(0.25, 0.25, 0.0), Vec3::Z);
        assert!(std::thread::spawn(move || scene.occluded(&ray)).join().unwrap());
    }

    /// Embree builds with denormals flushed to zero; our own arithmetic must not inherit that.
    #[test]
    fn building_leaves_denormals_as_they_were() {
        let device = Device::new("").unwrap();
        EmbreeScene::build(&device, &[triangle(1.0)], Options::default()).unwrap();
        device.limit_memory(1);
        EmbreeScene::build(&device, &[triangle(1.0)], Options::default()).unwrap_err();
        assert!(std::hint::black_box(f32::MIN_POSITIVE) / 2.0 > 0.0);
    }
}
