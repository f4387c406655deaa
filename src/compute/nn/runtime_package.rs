use super::error::NnError;
use super::network_file::{FileAddress, FileKind, NetworkFile};
use super::runtime::library_name;

/// Version of ONNX Runtime that is installed.
#[cfg(test)]
const VERSION: &str = "1.31.1";

/// Package of ONNX Runtime for one system: a ZIP archive (a wheel) with the library.
#[derive(Debug)]
pub(super) struct RuntimePackage {
    os: &'static str,
    arch: &'static str,
    /// Address of the package; it contains the file's BLAKE2b digest.
    url: &'static str,
    bytes: u64,
    sha256: &'static str,
    /// Path of the library in the archive.
    library: &'static str,
}

/// Packages of the Python Package Index.
///
/// The digests were computed from the files that it served in November 2026. Only the library is
/// taken from them, which depends on no version of Python.
const RUNTIME_PACKAGES: [RuntimePackage; 5] = [
    RuntimePackage {
        os: "macos",
        arch: "aarch64",
        url: "https://files.pythonhosted.org/packages/0e/f7/cecc0efeeea83bff2f7789ae1b80f27fa0f0210d6d9d66d1f0031a6b5e47/onnxruntime-1.31.1-cp312-cp312-macosx_14_0_arm64.whl",
        bytes: 20882125,
        sha256: "96dd2564b10ea7153ad9c207e7cd8e5917cb3ba521e0e0a62ac03486fdc8d56c",
        library: "onnxruntime/capi/libonnxruntime.1.31.1.dylib",
    },
    RuntimePackage {
        os: "linux",
        arch: "aarch64",
        url: "https://files.pythonhosted.org/packages/ba/e4/1ed1a7a5f4702d899091fa2b976d377995250c307326ec8dc9ae6378aa13/onnxruntime-1.31.1-cp312-cp312-manylinux_2_28_aarch64.whl",
        bytes: 21420803,
        sha256: "0b9a492176886992e0e875f06bc0367e333f5fff11711a2d642e18b02f3009cc",
        library: "onnxruntime/capi/libonnxruntime.so.1.31.1",
    },
    RuntimePackage {
        os: "linux",
        arch: "x86_64",
        url: "https://files.pythonhosted.org/packages/eb/27/c6a823bac55b2977bea2027c3ec9393a2c1002cb9a09eb40354563e02730/onnxruntime-1.31.1-cp312-cp312-manylinux_2_28_x86_64.whl",
        bytes: 23760988,
        sha256: "1f3dea47f2f0e5117c2404cea7d21fd253ae7836a3bf167a501cdfbb2600d536",
        library: "onnxruntime/capi/libonnxruntime.so.1.31.1",
    },
    RuntimePackage {
        os: "windows",
        arch: "x86_64",
        url: "https://files.pythonhosted.org/packages/45/b2/793b4051d8dc6acb379ead9b72050f0ffa283ca49a6904add2e218b83e2e/onnxruntime-1.31.1-cp312-cp312-win_amd64.whl",
        bytes: 14888466,
        sha256: "ae8a9a351efda685cc59a66226cdefaa37a126c1d66872ca23a2de9425326130",
        library: "onnxruntime/capi/onnxruntime.dll",
    },
    RuntimePackage {
        os: "windows",
        arch: "aarch64",
        url: "https://files.pythonhosted.org/packages/ed/72/09d635ab4b6137d8ac63d4911a37dad8b1ef15a77d20b65d7ed40fdca012/onnxruntime-1.31.1-cp312-cp312-win_arm64.whl",
        bytes: 14740724,
        sha256: "fe8b9ac1ae8e894e12c47ee82e4f6dfc1835768133687257866469fda80d0bf1",
        library: "onnxruntime/capi/onnxruntime.dll",
    },
];

impl RuntimePackage {
    /// Returns the package for this system.
    ///
    /// # Errors
    /// [`NnError::Request`] if there is none; the message states what to do instead.
    pub(super) fn for_this_system() -> Result<&'static Self, NnError> {
        let (os, arch) = (std::env::consts::OS, std::env::consts::ARCH);
        RUNTIME_PACKAGES.iter().find(|package| (package.os, package.arch) == (os, arch)).ok_or_else(|| {
            NnError::Request(format!(
                "no verified file of ONNX Runtime is known for {os} on {arch}; install ONNX Runtime 1.24 or newer by other \
                 means and set ORT_DYLIB_PATH to its library, or run `ostra models add onnxruntime FILE`"
            ))
        })
    }

    /// Returns the library as a file of a catalogue.
    pub(super) fn file(&self) -> NetworkFile {
        NetworkFile {
            about_mb: None,
            name: library_name(),
            kind: FileKind::Data,
            bytes: None,
            sha256: None,
            other_sha256: Vec::new(),
            addresses: vec![FileAddress {
                url: self.url.to_owned(),
                member: Some(self.library.to_owned()),
                is_gzip: false,
                bytes: Some(self.bytes),
                sha256: Some(self.sha256.to_owned()),
            }],
            signature: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packages_have_https_addresses_and_complete_digests() {
        for package in &RUNTIME_PACKAGES {
            assert!(
                package.url.starts_with("https://") && package.url.contains(VERSION),
                "{}",
                package.url
            );
            assert!(
                package.sha256.len() == 64
                    && package.sha256.bytes().all(|byte| byte.is_ascii_hexdigit())
            );
            let platform = match (package.os, package.arch) {
                ("macos", "aarch64") => "macosx_14_0_arm64",
                ("linux", "aarch64") => "manylinux_2_28_aarch64",
                ("linux", "x86_64") => "manylinux_2_28_x86_64",
                ("windows", "x86_64") => "win_amd64",
                ("windows", "aarch64") => "win_arm64",
                other => panic!("{other:?}"),
            };
            let file = package.file();
            let name = file.addresses[0].file_name();
            assert!(name.ends_with(".whl") && name.contains(platform));
        }
    }
}
