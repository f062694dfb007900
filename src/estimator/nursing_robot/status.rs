//! What the two filters did with the last sample, as numbers with words.

crate::code! {
    /// What the mass filter did.
    pub enum MassStatus {
        /// The estimate was updated.
        Updated = 0, "updated";
        /// The sample went into the pool of the first estimate.
        Pooling = 1, "pooling";
        /// Too slow.
        NotMoving = 2, "not-moving";
        /// The acceleration says nothing about the mass.
        NotExcited = 3, "not-excited";
        /// A wheel slips: the prediction error was too large.
        Rejected = 4, "rejected";
        /// A sample was missing, or there was a gap before it.
        Bad = 5, "bad";
        /// Held for a while after rejected or bad.
        Blocked = 6, "blocked";
    }
}

crate::code! {
    /// What the sway filter did.
    pub enum SwayStatus {
        /// All its channels were used.
        Updated = 0, "updated";
        /// A channel had no sample.
        Missing = 2, "missing";
        /// The wheels are held, the speed is known to be zero.
        Held = 3, "held";
        /// The samples were rejected by the gate.
        Gated = 4, "gated";
        /// Restarted after a gap.
        Gap = 5, "gap";
        /// The step was rolled back.
        RolledBack = 6, "rolled-back";
        /// Restarted beyond the pitch limit.
        Restarted = 7, "restarted";
        /// The speed was reset to its measurement after rejections in a row.
        Realigned = 8, "realigned";
        /// Switched off, or nothing sways.
        Off = 9, "off";
    }
}
