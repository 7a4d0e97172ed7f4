//! How sure a sensor's decoder is that a packet is its own; what tells several sensors on one port apart.

/// How surely a packet comes from a sensor; the greater wins.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Claim {
    /// Another sensor's or another format's.
    No,
    /// The format fits; the port says otherwise, or nothing says more.
    Possible,
    /// Format and port fit.
    Likely,
    /// Format fits and the packet comes from where this sensor's earlier packets came from.
    Familiar,
    /// The packet carries this sensor's serial number, and its length is another format's: the sensor was set differently, or
    /// the packet is damaged.
    Named,
    /// The packet carries this sensor's serial number, and its length fits.
    Certain,
}
