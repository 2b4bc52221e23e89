//! The files of a run as links in its page. A link is the name of a file in the page's own folder.

use super::text::escape;

/// What each file holds.
const HOLDS: [(&str, &str); 12] = [
    ("rows.csv", "every measurement with its predictions"),
    ("fields.vtp", "maps at every vertex, for ParaView"),
    ("summary.csv", "a line per parameter"),
    ("summary.json", "the same"),
    ("draws.csv", "every draw of every parameter"),
    ("posterior.zarr", "the same and more, a folder for ArviZ"),
    ("loo.csv", "leave-one-out elpd and Pareto k of every measurement"),
    ("model.rs", "the model, as it was fitted"),
    ("measurements.csv", "the table that was fitted"),
    ("field_draws.npz", "draws of whole fields"),
    ("unknowns.npz", "draws as the sampler saw them, for --init and `eplat predict`"),
    ("run.json", "the record of the run"),
];

/// The files with what they hold.
pub(super) fn list(files: &[&str]) -> String {
    let term = |name: &&str| {
        let holds = HOLDS.iter().find(|(known, _)| known == name).map_or("", |(_, holds)| holds);
        format!("<dt>{}<dd>{}", link(name), escape(holds))
    };
    files.iter().map(term).collect()
}

/// `text` with the name of each of `files` in it made a link; nothing else of it may be a name.
pub(super) fn linked(text: &str, files: &[&str]) -> String {
    files.iter().fold(text.to_owned(), |text, name| text.replace(name, &link(name)))
}

fn link(name: &str) -> String {
    let name = escape(name);
    format!("<a href=\"{name}\">{name}</a>")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_files_that_are_there_become_links() {
        let text = linked("fields.vtp and loo.csv hold them", &["fields.vtp"]);
        assert_eq!(text, "<a href=\"fields.vtp\">fields.vtp</a> and loo.csv hold them");
        assert_eq!(list(&["mine.csv"]), "<dt><a href=\"mine.csv\">mine.csv</a><dd>");
    }
}
