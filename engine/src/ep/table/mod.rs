//! CSV tables of strip parameters and strip outcomes.
//!
//! Columns are found by name, in any order; unknown ones are ignored.  An absent value is an empty
//! cell.  Files are written under a temporary name and renamed, so a file that exists is whole.

mod error;
mod files;
mod rows;
mod strips;

pub use error::TableError;
pub use files::{finish_rows, new_file, read_parameters, read_rows, write_text};
pub use rows::rounded;
pub use rows::{Columns, CurveRow, OutcomeRow, ParameterRow};
pub use strips::{StripTable, curve_intervals};

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;
    use crate::ep::Parameters;
    use crate::ep::strip::{Absence, Beat, StripOutcome};

    const HEADER: &str = "tau_in_ms,cv_max_m_per_s,tau_out_ms,tau_open_ms,apd_max_ms\n";

    fn read(text: &str) -> Result<Vec<Parameters>, String> {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(text.as_bytes()).unwrap();
        let in_file =
            |e: TableError| e.to_string().replace(&file.path().display().to_string(), "FILE");
        read_parameters(file.path()).map_err(in_file)
    }

    #[test]
    fn columns_are_found_by_name() {
        let rows = read(&format!("{HEADER}0.05, 0.7, 10, 120, 200\n")).unwrap();
        assert_eq!(rows, vec![Parameters::from_array([0.7, 0.05, 10.0, 120.0, 200.0])]);
    }

    #[test]
    fn bad_tables_name_the_place() {
        let message = |rows: &str| read(&format!("{HEADER}{rows}")).unwrap_err();
        let good = "0.05,0.7,10,120,200\n";
        assert!(
            message(&format!("{good}0.05,0.7,x,120,200\n"))
                .starts_with("FILE, line 3, column tau_out_ms: invalid float literal")
        );
        assert!(message(&format!("{good}0.05,0.7,10\n")).starts_with("FILE, line 3: "));
        assert!(message("").starts_with("FILE has no rows"));
        let missing = read("tau_in_ms\n1\n").unwrap_err();
        assert!(
            missing.starts_with("FILE has no column cv_max_m_per_s; it has: tau_in_ms\n"),
            "{missing}"
        );
    }

    fn written(row: OutcomeRow) -> Vec<(String, String)> {
        let file = tempfile::NamedTempFile::new().unwrap();
        finish_rows(new_file(file.path()).unwrap(), &[row]).unwrap();
        let mut reader = csv::Reader::from_path(file.path()).unwrap();
        let header = reader.headers().unwrap().clone();
        let cells = reader.records().next().unwrap().unwrap();
        header.iter().map(String::from).zip(cells.iter().map(String::from)).collect()
    }

    #[test]
    fn absent_values_are_empty_cells_with_a_reason() {
        let beat = Ok(Beat {
            cv: 0.712_345_6,
            apd20: None,
            apd30: Some(90.0),
            apd50: Some(140.0),
            apd90: 201.25,
        });
        let outcome = Ok(StripOutcome {
            s1: beat,
            erp_s2: Ok(310),
            s2: Err(Absence::NoActivation),
            erp_s3: Err(Absence::NoActivation),
            restitution: vec![],
        });
        let parameters = Parameters::from_array([0.7, 0.05, 10.0, 120.0, 200.0]);
        let cells = written(OutcomeRow::new(3, parameters, &outcome));
        let cell = |name: &str| cells.iter().find(|(n, _)| n == name).unwrap().1.as_str();
        assert_eq!(
            [cell("cv_s1_m_per_s"), cell("apd50_s1_ms"), cell("apd90_s1_ms")],
            ["0.71235", "140.0", "201.25"]
        );
        assert_eq!([cell("erp_s2_ms"), cell("erp_s2_absence")], ["310", ""]);
        assert_eq!([cell("apd90_s2_ms"), cell("erp_s3_ms"), cell("cv_restitution_a")], [""; 3]);
        assert_eq!(
            cell("erp_s3_absence"),
            "the conditioning stimulus did not activate the whole strip"
        );
    }

    #[test]
    fn a_set_out_of_range_is_an_absence() {
        let parameters = Parameters::from_array([0.7, 0.05, 10.0, 120.0, 900.0]);
        let out = Err(parameters.validate().unwrap_err());
        let cells = written(OutcomeRow::new(0, parameters, &out));
        let reasons = cells.iter().filter(|(_, cell)| {
            cell == "apd_max = 900 ms is outside its valid range 120 to 270 ms"
        });
        assert_eq!(reasons.count(), 2);
        assert!(cells[8..28].iter().all(|(_, cell)| cell.is_empty()));
    }
}
