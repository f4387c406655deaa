/// A zip file being written, its files stored as they are (APPNOTE.TXT, PKWARE). Without times, so that equal content
/// gives equal bytes.
#[derive(Default)]
pub(super) struct Zip {
    directory: Vec<u8>,
    files: u16,
    written: u32,
}

impl Zip {
    /// The bytes that stand before a file's content, which must follow at once; `None` beyond 4 GiB.
    pub(super) fn add(&mut self, name: &str, content: &[u8]) -> Option<Vec<u8>> {
        let size = u32::try_from(content.len()).ok()?;
        let mut shared = Vec::new();
        // Version 2.0 needed, no flags, stored, midnight, 1 January 1980.
        [20u16, 0, 0, 0, 0x21]
            .iter()
            .for_each(|number| shared.extend(number.to_le_bytes()));
        [crc32(content), size, size]
            .iter()
            .for_each(|number| shared.extend(number.to_le_bytes()));
        shared.extend((name.len() as u16).to_le_bytes());
        shared.extend(0u16.to_le_bytes());
        let head = [b"PK\x03\x04", &shared[..], name.as_bytes()].concat();
        self.directory.extend_from_slice(b"PK\x01\x02\x14\x00");
        self.directory.extend_from_slice(&shared);
        // No comment, first disk, no attributes; then where the file begins.
        self.directory.extend_from_slice(&[0; 10]);
        self.directory.extend(self.written.to_le_bytes());
        self.directory.extend_from_slice(name.as_bytes());
        self.files += 1;
        self.written = self
            .written
            .checked_add(head.len() as u32)?
            .checked_add(size)?;
        Some(head)
    }

    /// The bytes that end the zip.
    pub(super) fn end(self) -> Vec<u8> {
        let mut bytes = self.directory;
        let length = bytes.len() as u32;
        bytes.extend_from_slice(b"PK\x05\x06\0\0\0\0");
        [self.files; 2]
            .iter()
            .for_each(|number| bytes.extend(number.to_le_bytes()));
        [length, self.written]
            .iter()
            .for_each(|number| bytes.extend(number.to_le_bytes()));
        bytes.extend_from_slice(&[0; 2]);
        bytes
    }
}

/// The checksum of zip and PNG (ITU-T V.42), reflected polynomial 0xedb88320.
fn crc32(bytes: &[u8]) -> u32 {
    const TABLE: [u32; 256] = table();
    !bytes.iter().fold(!0, |crc: u32, &byte| {
        TABLE[usize::from(crc as u8 ^ byte)] ^ (crc >> 8)
    })
}

const fn table() -> [u32; 256] {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let (mut crc, mut bit) = (byte as u32, 0);
        while bit < 8 {
            crc = if crc & 1 == 1 {
                0xedb8_8320 ^ (crc >> 1)
            } else {
                crc >> 1
            };
            bit += 1;
        }
        table[byte] = crc;
        byte += 1;
    }
    table
}

#[cfg(test)]
mod tests {
    #[test]
    fn checksum_of_the_standard() {
        assert_eq!(super::crc32(b"123456789"), 0xcbf4_3926);
    }
}
