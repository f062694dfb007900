//! Sparse rows whose pattern is fixed and of whose values some follow the posture. By hand, since a crate's sparse
//! matrix does not know which of its values vary, and no algebra is done here.

/// Rows `value * d + offset`, compressed by rows.
#[derive(Clone, Debug, Default)]
pub struct Rows {
    /// Where each row starts in `column` and `value`; one more than there are rows.
    pub start: Vec<usize>,
    /// Column of each entry.
    pub column: Vec<u32>,
    /// Value of each entry.
    pub value: Vec<f64>,
    /// Whether the entry's value ever changes.
    pub varies: Vec<bool>,
    /// The constant term of each row, `b_D` or `b_Y`.
    pub offset: Vec<f64>,
}

impl Rows {
    /// Number of rows.
    pub fn len(&self) -> usize {
        self.offset.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.offset.is_empty()
    }

    /// A row times several columns of variables.
    pub fn times<const K: usize>(&self, row: usize, variables: &[[f64; K]]) -> [f64; K] {
        let mut sums = [0.0; K];
        for entry in self.start[row]..self.start[row + 1] {
            let value = self.value[entry];
            for (sum, variable) in sums.iter_mut().zip(&variables[self.column[entry] as usize]) {
                *sum += value * variable;
            }
        }
        sums
    }
}

/// Where a candidate entry takes its value from.
#[derive(Clone, Copy, Debug)]
pub(super) enum Origin {
    /// A constant.
    Constant(f64),
    /// Slot of the table of moving values, and a sign.
    Slot(usize, f64),
}

/// Collects candidate entries; those that turn out to be zero in every posture are left out.
#[derive(Clone, Debug, Default)]
pub(super) struct RowsBuilder {
    start: Vec<usize>,
    entries: Vec<(u32, Origin)>,
}

/// One value to be copied per step: `value[entry] = sign * slots[slot]`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Copy {
    pub entry: u32,
    pub slot: u32,
    pub sign: f64,
}

impl RowsBuilder {
    /// Begins a row.
    pub fn row(&mut self) {
        self.start.push(self.entries.len());
    }

    /// Adds an entry to the row begun last.
    pub fn push(&mut self, column: usize, origin: Origin) {
        self.entries.push((column as u32, origin));
    }

    /// Settles pattern and constants from the moving values in several generic postures: what is
    /// zero in all of them is zero by structure, what is equal in all of them is constant.
    pub fn finish(&self, postures: &[Vec<f64>]) -> (Rows, Vec<Copy>) {
        let mut rows = Rows::default();
        let mut copies = Vec::new();
        for r in 0..self.start.len() {
            rows.start.push(rows.column.len());
            rows.offset.push(0.0);
            let end = self.start.get(r + 1).copied().unwrap_or(self.entries.len());
            let mut entries = self.entries[self.start[r]..end].to_vec();
            entries.sort_by_key(|(column, _)| *column);
            for (column, origin) in entries {
                let (value, varies) = match origin {
                    Origin::Constant(value) => (value, false),
                    Origin::Slot(slot, sign) => {
                        let first = postures[0][slot];
                        let varies = postures.iter().any(|p| p[slot] != first);
                        if varies {
                            copies.push(Copy { entry: rows.column.len() as u32, slot: slot as u32, sign });
                        }
                        (sign * first, varies)
                    }
                };
                if value != 0.0 || varies {
                    rows.column.push(column);
                    rows.value.push(value);
                    rows.varies.push(varies);
                }
            }
        }
        rows.start.push(rows.column.len());
        (rows, copies)
    }
}
