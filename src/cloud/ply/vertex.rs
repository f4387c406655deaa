use ply_rs::ply::{Property, PropertyAccess, PropertyAccessResult};

/// The meaning of a vertex property in a file of another program.
///
/// It is also the index in [`Vertex`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum VertexSlot {
    X,
    Y,
    Z,
    Nx,
    Ny,
    Nz,
    Red,
    Green,
    Blue,
    Label,
    Confidence,
    /// Read and discarded.
    Other,
}

/// Number of [`VertexSlot`]s.
const SLOTS: usize = VertexSlot::Other as usize + 1;

impl VertexSlot {
    /// Returns the name under which a property of this slot is passed to ply-rs.
    ///
    /// The first byte is the slot, the rest makes names unique. Only one byte is examined per
    /// value; matching the file's own names took most of the reading time.
    pub(super) fn property_name(self, column: usize) -> String {
        format!("{}{column}", char::from(b'a' + self as u8))
    }
}

/// One vertex being read: every scalar as `f64`, by [`VertexSlot`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Vertex([f64; SLOTS]);

impl Vertex {
    /// Returns the value of a slot, or 0 if the file does not have it.
    pub(super) fn at(&self, slot: VertexSlot) -> f64 {
        self.0[slot as usize]
    }

    /// Sets the value of a slot.
    pub(super) fn put(&mut self, slot: VertexSlot, value: f64) {
        self.0[slot as usize] = value;
    }

    fn put_named(&mut self, name: &str, value: f64) -> PropertyAccessResult {
        let slot = name
            .as_bytes()
            .first()
            .map_or(SLOTS, |first| usize::from(first.wrapping_sub(b'a')));
        self.0[slot.min(SLOTS - 1)] = value;
        PropertyAccessResult::Set
    }
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self([0.0; SLOTS])
    }

    fn set_property(&mut self, _name: &str, _list: Property) -> PropertyAccessResult {
        PropertyAccessResult::Ignored
    }

    fn set_char(&mut self, name: &str, value: i8) -> PropertyAccessResult {
        self.put_named(name, f64::from(value))
    }

    fn set_uchar(&mut self, name: &str, value: u8) -> PropertyAccessResult {
        self.put_named(name, f64::from(value))
    }

    fn set_short(&mut self, name: &str, value: i16) -> PropertyAccessResult {
        self.put_named(name, f64::from(value))
    }

    fn set_ushort(&mut self, name: &str, value: u16) -> PropertyAccessResult {
        self.put_named(name, f64::from(value))
    }

    fn set_int(&mut self, name: &str, value: i32) -> PropertyAccessResult {
        self.put_named(name, f64::from(value))
    }

    fn set_uint(&mut self, name: &str, value: u32) -> PropertyAccessResult {
        self.put_named(name, f64::from(value))
    }

    fn set_float(&mut self, name: &str, value: f32) -> PropertyAccessResult {
        self.put_named(name, f64::from(value))
    }

    fn set_double(&mut self, name: &str, value: f64) -> PropertyAccessResult {
        self.put_named(name, value)
    }
}
