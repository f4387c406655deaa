use std::fs;

use serde::Serialize;

/// The machine that a bench ran on. It has no name of the machine or its user.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Machine {
    /// Model of the processor; `None` if the system does not report it.
    pub processor: Option<String>,
    /// Number of cores that programs may use.
    pub cores: usize,
    /// Size of the main memory in bytes; `None` if the system does not report it.
    pub memory_bytes: Option<u64>,
    /// Operating system.
    pub system: String,
}

impl Machine {
    /// Describes this machine.
    #[must_use]
    pub fn this() -> Self {
        Self {
            processor: processor(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            memory_bytes: field("/proc/meminfo", "MemTotal").and_then(|text| kilobytes(&text)),
            system: system(),
        }
    }

    /// Returns the description on one line.
    #[must_use]
    pub fn text(&self) -> String {
        let processor = self.processor.as_deref().unwrap_or("processor not known");
        let memory = self
            .memory_bytes
            .map_or("memory not known".into(), |bytes| {
                format!("{:.1} GB memory", bytes as f64 / 1e9)
            });
        let Self { cores, system, .. } = self;
        let s = if *cores == 1 { "" } else { "s" };
        format!("{processor}, {cores} core{s}, {memory}, {system}")
    }
}

fn processor() -> Option<String> {
    // Windows gives it to every process.
    field("/proc/cpuinfo", "model name").or_else(|| std::env::var("PROCESSOR_IDENTIFIER").ok())
}

fn system() -> String {
    let name =
        field("/etc/os-release", "PRETTY_NAME").map(|name| name.trim_matches('"').to_owned());
    let system = format!("{} {}", std::env::consts::OS, std::env::consts::ARCH);
    name.map_or(system.clone(), |name| format!("{name} ({system})"))
}

/// Returns the value of a line `NAME : VALUE` or `NAME=VALUE` of a file of the system.
fn field(file: &str, name: &str) -> Option<String> {
    let text = fs::read_to_string(file).ok()?;
    let value = text.lines().find_map(|line| {
        let rest = line.strip_prefix(name)?.trim_start();
        rest.strip_prefix([':', '='])
    })?;
    Some(value.trim().to_owned())
}

/// Parses a size such as `24576 kB`, in bytes.
fn kilobytes(text: &str) -> Option<u64> {
    let number: u64 = text.strip_suffix("kB")?.trim().parse().ok()?;
    Some(number * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_of_the_system_are_read() {
        assert_eq!(kilobytes("24576 kB"), Some(24576 << 10));
        assert_eq!(kilobytes("24576"), None);
    }

    #[test]
    fn what_the_system_does_not_report_is_not_known() {
        let machine = Machine {
            processor: None,
            cores: 2,
            memory_bytes: Some(8_000_000_000),
            system: "linux x86_64".into(),
        };
        assert_eq!(
            machine.text(),
            "processor not known, 2 cores, 8.0 GB memory, linux x86_64"
        );
    }
}
