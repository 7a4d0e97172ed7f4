use super::Findings;

impl Findings {
    /// For a terminal.
    pub(crate) fn text(&self, study: &str) -> String {
        let mut text = format!("{}: {}\n", study, self.summary);
        for claim in &self.claims {
            text += &format!("{:15} {}: {}\n", claim.verdict.words(), claim.claim, claim.because);
        }
        for table in &self.tables {
            text += &format!("\n{}\n", table.title);
            let widths: Vec<usize> = (0..table.columns.len())
                .map(|at| {
                    let cells = std::iter::once(&table.columns).chain(&table.rows);
                    cells
                        .filter_map(|cells| cells.get(at))
                        .map(|cell| cell.chars().count())
                        .max()
                        .unwrap_or(0)
                })
                .collect();
            for cells in std::iter::once(&table.columns).chain(&table.rows) {
                let padded: Vec<String> =
                    cells.iter().zip(&widths).map(|(cell, width)| format!("{cell:width$}")).collect();
                text += &format!("{}\n", padded.join("  ").trim_end());
            }
        }
        text
    }
}
