use std::path::Path;

use super::error::NnError;

/// Version of ONNX Runtime that is installed.
pub(super) const VERSION: &str = "1.31.1";

/// The Python package of ONNX Runtime for one system: a ZIP archive that holds the library.
#[derive(Debug)]
pub(super) struct Wheel {
    os: &'static str,
    arch: &'static str,
    /// The system as pip calls it.
    pub platform: &'static str,
    /// Address of the file, which holds the file's BLAKE2b digest.
    pub url: &'static str,
    pub bytes: u64,
    pub sha256: &'static str,
    /// Name of the library within the archive.
    pub library: &'static str,
}

/// Python version of the packages in [`WHEELS`]; the library in them does not depend on it.
pub(super) const PYTHON_VERSION: &str = "3.12";

/// The packages of the Python Package Index, with digests computed from the files that it served in November 2026.
const WHEELS: [Wheel; 5] = [
    Wheel {
        os: "macos",
        arch: "aarch64",
        platform: "macosx_14_0_arm64",
        url: "https://files.pythonhosted.org/packages/0e/f7/cecc0efeeea83bff2f7789ae1b80f27fa0f0210d6d9d66d1f0031a6b5e47/onnxruntime-1.31.1-cp312-cp312-macosx_14_0_arm64.whl",
        bytes: 20882125,
        sha256: "96dd2564b10ea7153ad9c207e7cd8e5917cb3ba521e0e0a62ac03486fdc8d56c",
        library: "onnxruntime/capi/libonnxruntime.1.31.1.dylib",
    },
    Wheel {
        os: "linux",
        arch: "aarch64",
        platform: "manylinux_2_28_aarch64",
        url: "https://files.pythonhosted.org/packages/ba/e4/1ed1a7a5f4702d899091fa2b976d377995250c307326ec8dc9ae6378aa13/onnxruntime-1.31.1-cp312-cp312-manylinux_2_28_aarch64.whl",
        bytes: 21420803,
        sha256: "0b9a492176886992e0e875f06bc0367e333f5fff11711a2d642e18b02f3009cc",
        library: "onnxruntime/capi/libonnxruntime.so.1.31.1",
    },
    Wheel {
        os: "linux",
        arch: "x86_64",
        platform: "manylinux_2_28_x86_64",
        url: "https://files.pythonhosted.org/packages/eb/27/c6a823bac55b2977bea2027c3ec9393a2c1002cb9a09eb40354563e02730/onnxruntime-1.31.1-cp312-cp312-manylinux_2_28_x86_64.whl",
        bytes: 23760988,
        sha256: "1f3dea47f2f0e5117c2404cea7d21fd253ae7836a3bf167a501cdfbb2600d536",
        library: "onnxruntime/capi/libonnxruntime.so.1.31.1",
    },
    Wheel {
        os: "windows",
        arch: "x86_64",
        platform: "win_amd64",
        url: "https://files.pythonhosted.org/packages/45/b2/793b4051d8dc6acb379ead9b72050f0ffa283ca49a6904add2e218b83e2e/onnxruntime-1.31.1-cp312-cp312-win_amd64.whl",
        bytes: 14888466,
        sha256: "ae8a9a351efda685cc59a66226cdefaa37a126c1d66872ca23a2de9425326130",
        library: "onnxruntime/capi/onnxruntime.dll",
    },
    Wheel {
        os: "windows",
        arch: "aarch64",
        platform: "win_arm64",
        url: "https://files.pythonhosted.org/packages/ed/72/09d635ab4b6137d8ac63d4911a37dad8b1ef15a77d20b65d7ed40fdca012/onnxruntime-1.31.1-cp312-cp312-win_arm64.whl",
        bytes: 14740724,
        sha256: "fe8b9ac1ae8e894e12c47ee82e4f6dfc1835768133687257866469fda80d0bf1",
        library: "onnxruntime/capi/onnxruntime.dll",
    },
];

impl Wheel {
    /// The package for this system.
    ///
    /// # Errors
    /// [`NnError::Request`] where none is known; says what to do instead.
    pub fn for_this_system() -> Result<&'static Self, NnError> {
        let (os, arch) = (std::env::consts::OS, std::env::consts::ARCH);
        WHEELS.iter().find(|wheel| (wheel.os, wheel.arch) == (os, arch)).ok_or_else(|| {
            NnError::Request(format!(
                "no verified file of ONNX Runtime is known for {os} on {arch}; install ONNX Runtime 1.24 or newer by other \
                 means and set ORT_DYLIB_PATH to its library, or run `ostra models add onnxruntime FILE`"
            ))
        })
    }

    /// Name of the package's file.
    pub fn file_name(&self) -> &'static str {
        Path::new(self.url)
            .file_name()
            .and_then(|name| name.to_str())
            .unwrap_or(self.platform)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packages_are_fetched_by_https_and_have_whole_digests() {
        for wheel in &WHEELS {
            assert!(
                wheel.url.starts_with("https://") && wheel.url.contains(VERSION),
                "{}",
                wheel.url
            );
            assert!(
                wheel.sha256.len() == 64
                    && wheel.sha256.bytes().all(|byte| byte.is_ascii_hexdigit())
            );
            assert!(
                wheel.file_name().ends_with(".whl") && wheel.file_name().contains(wheel.platform)
            );
        }
    }
}
