//! How far the host runs ahead of the device.

/// Most events in flight.
pub(super) const MOST_IN_FLIGHT: usize = 32;
/// Most threads that decode photographs during a training; the photographs of the next steps need no more.
const MOST_DECODERS: usize = 8;

/// Where the photographs are during a training.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub enum Residency {
    /// On the device if they take at most half of the memory that the training may use, else streamed.
    #[default]
    Auto,
    /// All on the device from the beginning.
    Resident,
    /// Each photograph is uploaded in the step that looks at it, from memory that the host fills some steps ahead.
    Streamed,
}

/// How far the host may run ahead of the device, how large the buffers start, and where the photographs are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pacing {
    /// Events submitted whose outcome the host has not read, from 1 to 32. With 3 or more the wait never drains the
    /// device.
    pub events_in_flight: usize,
    /// Splats that fit before the first growth; 0 for a capacity chosen from the input.
    pub splat_capacity: u32,
    /// (splat, tile) pairs that fit before the first growth; 0 for a capacity chosen from the input.
    pub pair_capacity: u32,
    /// Where the photographs are.
    pub photographs: Residency,
    /// Photographs decoded ahead of their steps, at least 1, if decoded photographs are not kept.
    pub decoded_ahead: usize,
    /// Threads that decode photographs; 0 for the number of cores, at most 8.
    pub decoders: usize,
}

impl Default for Pacing {
    fn default() -> Self {
        Self {
            events_in_flight: 4,
            splat_capacity: 0,
            pair_capacity: 0,
            photographs: Residency::Auto,
            decoded_ahead: 4,
            decoders: 0,
        }
    }
}

impl Pacing {
    pub(super) fn events_in_flight(self) -> usize {
        self.events_in_flight.clamp(1, MOST_IN_FLIGHT)
    }

    pub(super) fn decoders(self) -> usize {
        match self.decoders {
            0 => crate::dataset::cores().min(MOST_DECODERS),
            given => given,
        }
    }
}
