//! Finds Embree and generates the bindings of the header found. Does nothing without the feature `embree`.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rustc-check-cfg=cfg(embree_major, values(\"3\", \"4\"))");
    #[cfg(feature = "embree")]
    if let Err(message) = embree::configure() {
        eprintln!("{message}");
        std::process::exit(1);
    }
}

#[cfg(feature = "embree")]
mod embree {
    use std::path::{Path, PathBuf};
    use std::{env, fs, panic};

    /// What `src/accel/embree` calls. Types follow from the functions; everything else in the headers stays out.
    const FUNCTIONS: &[&str] = &[
        "rtcNewDevice",
        "rtcReleaseDevice",
        "rtcGetDeviceProperty",
        "rtcGetDeviceError",
        "rtcSetDeviceErrorFunction",
        "rtcSetDeviceMemoryMonitorFunction",
        "rtcNewScene",
        "rtcReleaseScene",
        "rtcSetSceneFlags",
        "rtcSetSceneBuildQuality",
        "rtcCommitScene",
        "rtcAttachGeometryByID",
        "rtcNewGeometry",
        "rtcReleaseGeometry",
        "rtcCommitGeometry",
        "rtcSetGeometryMask",
        "rtcSetGeometryBuildQuality",
        "rtcSetNewGeometryBuffer",
        "rtcSetSharedGeometryBuffer",
        "rtcSetGeometryInstancedScene",
        "rtcSetGeometryTransform",
        "rtcIntersect1",
        "rtcOccluded1",
        "rtcIntersect16",
        "rtcOccluded16",
    ];
    const TYPES: &[&str] = &["RTCRayHit"];
    const CONSTANTS: &[&str] = &["RTC_VERSION_MAJOR", "RTC_VERSION_MINOR", "RTC_VERSION_STRING"];

    const ADVICE: &str = "\
        On Debian and Ubuntu: apt install libembree-dev libclang-dev\n\
        Elsewhere: set EMBREE_DIR to the folder that has Embree's include/ and lib/.\n\
        A build without Embree: cargo build --release --no-default-features --features obvhs";

    struct Installation {
        major: &'static str,
        include: PathBuf,
        /// Where the library is, if not in a folder that the linker and the loader search anyway.
        lib: Option<PathBuf>,
    }

    pub(super) fn configure() -> Result<(), String> {
        println!("cargo::rerun-if-env-changed=EMBREE_DIR");
        let installation = find()?;
        println!("cargo::rustc-cfg=embree_major=\"{}\"", installation.major);
        println!("cargo::rustc-link-lib=embree{}", installation.major);
        if let Some(lib) = &installation.lib {
            println!("cargo::rustc-link-search=native={}", lib.display());
            println!("cargo::rustc-link-arg=-Wl,-rpath,{}", lib.display());
        }
        generate(&installation)
    }

    fn find() -> Result<Installation, String> {
        let mut roots = Vec::new();
        if let Some(dir) = env::var_os("EMBREE_DIR").filter(|dir| !dir.is_empty()) {
            let dir = PathBuf::from(dir);
            roots.push((dir.join("include"), Some(dir.join("lib"))));
        }
        roots.push((PathBuf::from("/usr/include"), None));

        let mut searched = String::new();
        for (include, lib) in roots {
            for (folder, major) in [("embree4", "4"), ("embree3", "3")] {
                let header = include.join(folder).join("rtcore.h");
                if header.is_file() {
                    return Ok(Installation { major, include, lib });
                }
                searched += &format!("  {}\n", header.display());
            }
        }
        Err(format!("Embree was not found. Searched for:\n{searched}{ADVICE}"))
    }

    fn generate(installation: &Installation) -> Result<(), String> {
        require_libclang()?;
        let folder = format!("embree{}", installation.major);
        let header = installation.include.join(&folder).join("rtcore.h");
        for entry in fs::read_dir(installation.include.join(&folder))
            .into_iter()
            .flatten()
            .flatten()
        {
            println!("cargo::rerun-if-changed={}", entry.path().display());
        }
        let mut builder = bindgen::Builder::default()
            .header(header.display().to_string())
            .clang_arg(format!("-I{}", installation.include.display()))
            // A value that a newer library adds would be undefined behaviour in a Rust enum.
            .default_enum_style(bindgen::EnumVariation::NewType {
                is_bitfield: false,
                is_global: false,
            })
            .prepend_enum_name(false)
            .derive_default(true)
            .generate_cstr(true)
            .generate_comments(false)
            // Size, alignment and offset assertions: the library writes hits by the layout of its own header.
            .layout_tests(true);
        for name in FUNCTIONS {
            builder = builder.allowlist_function(name);
        }
        for name in TYPES {
            builder = builder.allowlist_type(name);
        }
        for name in CONSTANTS {
            builder = builder.allowlist_var(name);
        }
        let bindings = builder
            .generate()
            .map_err(|error| format!("{}: no bindings could be made: {error}\n{ADVICE}", header.display()))?;
        let path = Path::new(&env::var_os("OUT_DIR").ok_or("OUT_DIR is not set")?).join("embree.rs");
        bindings
            .write_to_file(&path)
            .map_err(|error| format!("{}: {error}", path.display()))
    }

    /// bindgen loads libclang when first used and panics without it: ask beforehand, to give the package's name.
    fn require_libclang() -> Result<(), String> {
        let hook = panic::take_hook();
        panic::set_hook(Box::new(|_| ()));
        let version = panic::catch_unwind(bindgen::clang_version);
        panic::set_hook(hook);
        match version {
            Ok(_) => Ok(()),
            Err(payload) => {
                let reason = payload
                    .downcast_ref::<String>()
                    .map(String::as_str)
                    .or_else(|| payload.downcast_ref::<&str>().copied())
                    .unwrap_or("unknown reason");
                Err(format!(
                    "The Embree bindings need libclang (package libclang-dev), which could not be loaded:\n  {reason}\n\
                     {ADVICE}"
                ))
            }
        }
    }
}
