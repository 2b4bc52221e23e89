//! Builds the documentation as a book: `docs/` and the pages that its `SUMMARY.md` names elsewhere.
//!
//! `mdBook` makes the pages. Before that, equations become `MathML` ([`equation`]) and every link is
//! followed ([`page`]). Afterwards the built pages are asked for the headings that links name, and
//! for anything that they would load from a network ([`built`]). Whatever is wrong stops the build
//! with its file and line.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::Context;
use mdbook_driver::MDBook;
use mdbook_driver::config::Config;
use mdbook_preprocessor::book::Book;
use mdbook_preprocessor::{Preprocessor, PreprocessorContext};

pub mod built;
pub mod equation;
pub mod fault;
pub mod page;

use fault::{Fault, refuse};
use page::{Anchor, Project, joined};

/// Builds the book of the project in `root` and returns its first page.
///
/// # Errors
/// Every fault of a page with its file and line; files that cannot be read or written.
pub fn build(root: &Path) -> anyhow::Result<PathBuf> {
    let config = Config::from_disk(root.join("book/book.toml"))?;
    let out = root.join(&config.build.build_dir);
    let mut book = MDBook::load_with_config(root, config)?;
    let anchors = Arc::new(Mutex::new(vec![]));
    book.with_preprocessor(Pages { anchors: anchors.clone() });
    book.build()?;
    let anchors = std::mem::take(&mut *anchors.lock().unwrap_or_else(PoisonError::into_inner));
    let mut faults = built::lost_anchors(&out, anchors)?;
    faults.extend(built::loads(&out)?);
    refuse(faults)?;
    Ok(out.join("index.html"))
}

/// The step between reading the pages and making HTML of them.
struct Pages {
    /// Links to headings, for a look at the built pages.
    anchors: Arc<Mutex<Vec<Anchor>>>,
}

impl Preprocessor for Pages {
    fn name(&self) -> &'static str {
        "eplat"
    }

    fn run(&self, context: &PreprocessorContext, mut book: Book) -> anyhow::Result<Book> {
        let source = context.config.book.src.clone();
        let project =
            Project { root: context.root.clone(), chapters: chapters(&source, &book), source };
        let mut faults = forgotten(&project)?;
        let mut anchors = vec![];
        book.for_each_chapter_mut(|chapter| {
            let Some(path) = chapter.source_path.clone() else { return };
            let Some(file) = joined(&project.source, &path.to_string_lossy()) else { return };
            let page = page::page(&project, &file, &chapter.content);
            chapter.content = page.text;
            chapter.path = project.chapters.get(&file).cloned();
            faults.extend(page.faults);
            anchors.extend(page.anchors);
        });
        refuse(faults)?;
        *self.anchors.lock().unwrap_or_else(PoisonError::into_inner) = anchors;
        Ok(book)
    }
}

/// The pages of the book. One from outside the folder of pages has its file's name in lower case.
fn chapters(source: &Path, book: &Book) -> BTreeMap<PathBuf, PathBuf> {
    let paths = book.chapters().filter_map(|chapter| chapter.source_path.as_ref());
    let files = paths.filter_map(|path| joined(source, &path.to_string_lossy()));
    let named = files.map(|file| {
        let name = match file.strip_prefix(source) {
            Ok(inside) => inside.to_path_buf(),
            Err(_) => file.file_name().unwrap_or_default().to_ascii_lowercase().into(),
        };
        (file, name)
    });
    named.collect()
}

/// Pages that the table of contents does not have.
fn forgotten(project: &Project) -> anyhow::Result<Vec<Fault>> {
    let folder = project.root.join(&project.source);
    let mut faults = vec![];
    for entry in fs::read_dir(&folder).with_context(|| folder.display().to_string())? {
        let name = entry?.file_name();
        let file = project.source.join(&name);
        let is_page = file.extension().is_some_and(|e| e == "md") && name != "SUMMARY.md";
        if is_page && !project.chapters.contains_key(&file) {
            let what = "this page is not in docs/SUMMARY.md: name it there".to_string();
            faults.push(Fault { file: file.display().to_string(), line: 1, what });
        }
    }
    Ok(faults)
}
