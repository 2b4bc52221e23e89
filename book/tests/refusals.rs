//! What is wrong in a page stops the build, with its file and line; what is right is in the book.
#![allow(clippy::unwrap_used, clippy::panic, missing_docs, reason = "tests")]

use std::fs;
use std::path::Path;

use tempfile::TempDir;

const SUMMARY: &str = "# Summary\n\n[Start](../README.md)\n\n- [One](one.md)\n- [Two](two.md)\n";

/// A project whose page `docs/one.md` is `page`.
fn project(page: &str) -> TempDir {
    let folder = TempDir::new().unwrap();
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    };
    write("README.md", "# Start\n\n[one](docs/one.md) and [two](docs/two.md#second-part)\n");
    write("docs/SUMMARY.md", SUMMARY);
    write("docs/one.md", page);
    write("docs/two.md", "# Two\n\n## Second part\n\nText.\n");
    write("src/field.rs", "/// A field.\npub fn density() {}\n");
    for name in ["book.toml", "eplat.css"] {
        let own = Path::new(env!("CARGO_MANIFEST_DIR")).join(name);
        write(&format!("book/{name}"), &fs::read_to_string(own).unwrap());
    }
    folder
}

/// What the build says against `page`.
fn refusal(page: &str) -> String {
    let folder = project(page);
    let said = eplat_book::build(folder.path()).err();
    format!("{:#}", said.unwrap_or_else(|| panic!("built: {page}")))
}

/// The built page of `page`.
fn html(page: &str) -> String {
    let folder = project(page);
    if let Err(error) = eplat_book::build(folder.path()) {
        panic!("{error:#}");
    }
    fs::read_to_string(folder.path().join("target/book/one.html")).unwrap()
}

#[test]
fn a_link_to_no_file_is_refused() {
    let said = refusal("# One\n\nText, and\na [link](three.md).\n");
    assert!(
        said.contains("docs/one.md:4: link to `three.md`: there is no `docs/three.md`"),
        "{said}"
    );
    let said = refusal("# One\n\n[code](../src/none.rs)\n");
    assert!(said.contains("docs/one.md:3: link to `../src/none.rs`"), "{said}");
    let said = refusal("# One\n\n![picture](none.png)\n");
    assert!(said.contains("docs/one.md:3: picture `none.png`"), "{said}");
    let said = refusal("# One\n\n[out](../../etc/passwd)\n");
    assert!(said.contains("docs/one.md:3") && said.contains("leaves the project"), "{said}");
}

#[test]
fn a_link_to_no_heading_is_refused() {
    let said = refusal(
        "# One\n\n[here](#two) [there](two.md#second-part)\n\n## Two\n\n[gone](two.md#third-part)\n",
    );
    assert!(
        said.contains("docs/one.md:7: link to `two.md#third-part`: `docs/two.md` has no such"),
        "{said}"
    );
    assert!(!said.contains("docs/one.md:3"), "{said}");
    let said = refusal("# One\n\n[gone](#nowhere)\n");
    assert!(said.contains("docs/one.md:3: link to `#nowhere`"), "{said}");
}

#[test]
fn a_wrong_equation_is_refused() {
    let said = refusal("# One\n\nGood: $a_k$.\n\n$$\na = b\n= \\nosuch\n$$\n");
    assert!(said.contains("docs/one.md:7: equation") && said.contains("nosuch"), "{said}");
    let said = refusal("# One\n\n```math\na = \\frac{1}{2\n```\n");
    assert!(said.contains("docs/one.md:4: equation"), "{said}");
    // to Markdown, `+` begins a list there
    let said = refusal("# One\n\n$$\na = b\n+ c\n$$\n");
    assert!(said.contains("docs/one.md:3: `$` without its partner"), "{said}");
}

#[test]
fn a_name_that_the_code_does_not_have_is_refused() {
    let said = refusal("# One\n\n[`gone`](../src/field.rs)\n");
    assert!(
        said.contains("docs/one.md:3: link to `../src/field.rs`: `src/field.rs` has no `gone`"),
        "{said}"
    );
}

#[test]
fn a_page_outside_the_table_of_contents_and_a_picture_from_the_network_are_refused() {
    let folder = project("# One\n\n![far](https://example.org/a.png)\n");
    fs::write(folder.path().join("docs/lost.md"), "# Lost\n").unwrap();
    let said = format!("{:#}", eplat_book::build(folder.path()).err().unwrap());
    assert!(said.contains("docs/lost.md:1: this page is not in docs/SUMMARY.md"), "{said}");
    assert!(said.contains("docs/one.md:3: picture `https://example.org/a.png`"), "{said}");
}

#[test]
fn html_that_nobody_follows_is_refused() {
    let said = refusal("# One\n\nA <a href=\"none.md\">link</a>.\n");
    assert!(said.contains("docs/one.md:3: a link or picture as HTML"), "{said}");
    let said = refusal(
        "# One\n\n<script>\nload(1)\n</script>\n<link rel=x\n href='https://a.org/x.css'>\n",
    );
    assert!(said.contains("docs/one.md:"), "{said}");
}

#[test]
fn all_faults_are_told_at_once() {
    let said = refusal("# One\n\n[a](a.md)\n\n$\\b_{$\n\n[c](c.md)\n");
    assert_eq!(said.matches("docs/one.md:").count(), 3, "{said}");
}

#[test]
fn equations_and_links_are_in_the_book() {
    let page = "# One\n\nThe $a_k$ of [two](two.md#second-part), [start](../README.md),\n\
        [`density`](../src/field.rs) and [`field.rs`](../src/field.rs).\n\n\
        | a | b |\n|---|---|\n| $\\lvert a_k \\rvert$ | $x^*$ |\n\n$$ b = \\sqrt{a} $$\n\n\
        ```rust\nmodel! { param a ~ Flat; }\n```\n";
    let html = html(page);
    assert_eq!(html.matches("<math").count(), 4, "{html}");
    assert!(html.contains("display=\"block\"") && html.contains("<msqrt>"), "{html}");
    assert!(
        html.contains("href=\"two.html#second-part\"") && html.contains("href=\"readme.html\""),
        "{html}"
    );
    assert!(html.contains("<code>density</code> (<code>src/field.rs</code>)"), "{html}");
    assert!(html.contains("and <code>src/field.rs</code>"), "{html}");
    assert!(!html.contains("fn main"), "{html}");
}
