//! One page: its equations become `MathML`, and its links lead somewhere in the book.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Component, Path, PathBuf};

use mdbook_markdown::pulldown_cmark::{
    CodeBlockKind, Event, LinkType, Options, Parser, Tag, TagEnd,
};

use crate::equation::{self, Place};
use crate::fault::Fault;

/// The project, as its pages see it.
#[derive(Debug)]
pub struct Project {
    /// Its folder.
    pub root: PathBuf,
    /// The folder of the pages, as a path in the project.
    pub source: PathBuf,
    /// The pages: from a Markdown file, as a path in the project, to its name in the book.
    pub chapters: BTreeMap<PathBuf, PathBuf>,
}

/// A link to a heading.
#[derive(Clone, Debug)]
pub struct Anchor {
    /// Where the link stands, and what it says.
    pub from: Fault,
    /// The chapter of the heading, by its name in the book.
    pub chapter: PathBuf,
    /// The heading's id.
    pub id: String,
}

/// A page for the book.
#[derive(Debug, Default)]
pub struct Page {
    /// Its Markdown.
    pub text: String,
    /// Its links to headings. Only the built book tells whether these exist.
    pub anchors: Vec<Anchor>,
    /// What is wrong with it.
    pub faults: Vec<Fault>,
}

/// Reads the page `file`, a path in the project, and makes the book's page of it.
pub fn page(project: &Project, file: &Path, text: &str) -> Page {
    let mut reader = Reader { project, file, text, edits: vec![], page: Page::default() };
    reader.read();
    let Reader { mut edits, mut page, .. } = reader;
    edits.sort_by_key(|(range, _)| range.start);
    let mut at = 0;
    for (range, new) in edits {
        page.text.push_str(&text[at..range.start]);
        page.text.push_str(&new);
        at = range.end;
    }
    page.text.push_str(&text[at..]);
    page
}

struct Reader<'p> {
    project: &'p Project,
    file: &'p Path,
    text: &'p str,
    /// What is written instead of a range of the text.
    edits: Vec<(Range<usize>, String)>,
    page: Page,
}

/// Where a link leads.
enum Target {
    /// To this address in the book.
    Book(String),
    /// To a file of the project that is not in the book.
    File(PathBuf),
}

impl Reader<'_> {
    fn read(&mut self) {
        let options = Options::ENABLE_TABLES
            | Options::ENABLE_FOOTNOTES
            | Options::ENABLE_STRIKETHROUGH
            | Options::ENABLE_MATH;
        let mut events = Parser::new_ext(self.text, options).into_offset_iter();
        let mut in_code = false;
        while let Some((event, range)) = events.next() {
            match event {
                Event::Text(text) if !in_code && text.contains('$') => self.dollar(range),
                Event::Html(html) | Event::InlineHtml(html)
                    if html.contains("href=") || html.contains("src=") =>
                {
                    let what =
                        "a link or picture as HTML: write it as Markdown, so that it is checked";
                    self.fault(range.start, what.to_string());
                }
                Event::InlineMath(latex) => self.equation(&latex, Place::Inline, range),
                Event::DisplayMath(latex) => self.equation(&latex, Place::Block, range),
                Event::Start(Tag::CodeBlock(CodeBlockKind::Fenced(info))) if &*info == "math" => {
                    let mut latex = String::new();
                    for (event, _) in events.by_ref() {
                        match event {
                            Event::Text(text) => latex.push_str(&text),
                            Event::End(TagEnd::CodeBlock) => break,
                            _ => {}
                        }
                    }
                    self.equation(&latex, Place::Block, range);
                }
                Event::Start(Tag::CodeBlock(_)) => in_code = true,
                Event::End(TagEnd::CodeBlock) => in_code = false,
                Event::Start(Tag::Link { link_type, dest_url, .. }) => {
                    self.link(link_type, &dest_url, range, false);
                }
                Event::Start(Tag::Image { link_type, dest_url, .. }) => {
                    self.link(link_type, &dest_url, range, true);
                }
                _ => {}
            }
        }
    }

    fn fault(&mut self, at: usize, what: String) {
        let fault = self.fault_at(at, what);
        self.page.faults.push(fault);
    }

    fn fault_at(&self, at: usize, what: String) -> Fault {
        let line = 1 + self.text[..at].matches('\n').count();
        Fault { file: shown(self.file), line, what }
    }

    /// A `$` that is part of no equation. One that means a dollar is written `\$`.
    fn dollar(&mut self, range: Range<usize>) {
        if !self.text[..range.start].ends_with('\\') {
            let what = "`$` without its partner: of an equation, both stand in one paragraph, the first \
                before a sign and the last behind one";
            self.fault(range.start, what.to_string());
        }
    }

    fn equation(&mut self, latex: &str, place: Place, range: Range<usize>) {
        match equation::mathml(latex, place) {
            Ok(html) => {
                // without the line break after a code block's fence
                let end = range.start + self.text[range.clone()].trim_end().len();
                let next = self.text[end..].chars().next();
                let sign = next.filter(|sign| place == Place::Inline && ".,;:".contains(*sign));
                self.edits.push(match sign {
                    Some(sign) => {
                        let html = format!("<span class=\"with-sign\">{html}{sign}</span>");
                        (range.start..end + 1, html)
                    }
                    None => (range.start..end, html),
                });
            }
            Err(mistake) => {
                let begin = self.text[range.clone()].find(latex.trim()).unwrap_or(0);
                let indented = latex.len() - latex.trim_start().len();
                let at = range.start
                    + begin
                    + mistake.at.saturating_sub(indented).min(latex.trim().len());
                let mut at = at.min(range.end);
                while !self.text.is_char_boundary(at) {
                    at -= 1;
                }
                let latex = latex.trim();
                self.fault(at, format!("equation `{latex}`: {}", mistake.what));
            }
        }
    }

    fn link(&mut self, kind: LinkType, to: &str, range: Range<usize>, is_image: bool) {
        if kind == LinkType::Email || to.starts_with("mailto:") {
            return;
        }
        if to.starts_with("http://") || to.starts_with("https://") {
            if is_image {
                let what = format!("picture `{to}` is on the network: keep it in docs/");
                self.fault(range.start, what);
            }
            return;
        }
        if kind != LinkType::Inline {
            let what =
                format!("link to `{to}`: write it as [text](path), so that it can be checked");
            return self.fault(range.start, what);
        }
        match self.target(to, range.start, is_image) {
            Ok(Target::Book(address)) => self.lead(to, &address, range),
            Ok(Target::File(path)) => self.name(&path, to, range),
            Err(why) => {
                let what = if is_image { "picture" } else { "link to" };
                self.fault(range.start, format!("{what} `{to}`: {why}"));
            }
        }
    }

    /// Where a link leads, or why it leads nowhere.
    fn target(&mut self, to: &str, at: usize, is_image: bool) -> Result<Target, String> {
        let (path, id) = to.split_once('#').map_or((to, None), |(path, id)| (path, Some(id)));
        let folder = self.file.parent().unwrap_or(Path::new(""));
        let path = match path {
            "" => self.file.to_path_buf(),
            _ => joined(folder, path).ok_or("it leaves the project")?,
        };
        if !self.project.root.join(&path).exists() {
            return Err(format!("there is no `{}` in the project", shown(&path)));
        }
        if let Some(chapter) = self.project.chapters.get(&path) {
            let mut address = shown(chapter);
            if let Some(id) = id {
                address = format!("{address}#{id}");
                let what = format!("link to `{to}`: `{}` has no such heading", shown(&path));
                let anchor = Anchor {
                    from: self.fault_at(at, what),
                    chapter: chapter.clone(),
                    id: id.to_string(),
                };
                self.page.anchors.push(anchor);
            }
            return Ok(Target::Book(address));
        }
        if id.is_some() {
            return Err(format!("`{}` is no page of the book and has no headings", shown(&path)));
        }
        if path.starts_with(&self.project.source) && path.extension().is_none_or(|e| e != "md") {
            let address = path.strip_prefix(&self.project.source).unwrap_or(&path);
            return Ok(Target::Book(shown(address)));
        }
        if is_image {
            return Err("a picture must lie in docs/, or the book is without it".into());
        }
        Ok(Target::File(path))
    }

    /// Writes another address into a link.
    fn lead(&mut self, to: &str, address: &str, range: Range<usize>) {
        if to == address || (to.starts_with('#') && address.ends_with(to)) {
            return;
        }
        let Some(at) = self.text[range.clone()].rfind(to) else {
            return self.fault(range.start, format!("link to `{to}`: write the path as it is"));
        };
        let at = range.start + at;
        self.edits.push((at..at + to.len(), address.to_string()));
    }

    /// A file that is not in the book is named instead of linked. A link whose text is a name in
    /// the code must lead to a file that has this name.
    fn name(&mut self, path: &Path, to: &str, range: Range<usize>) {
        let whole = &self.text[range.clone()];
        let text = whole.strip_prefix('[').and_then(|w| w.rsplit_once("](")).map(|(text, _)| text);
        let Some(text) = text else {
            return self.fault(range.start, format!("link to `{to}`: write it as [text](path)"));
        };
        let code = text.strip_prefix('`').and_then(|text| text.strip_suffix('`'));
        let path_text = shown(path);
        let is_path = |code: &str| path_text == code || path_text.ends_with(&format!("/{code}"));
        let new = match code {
            Some(code) if is_path(code.trim_end_matches('/')) => format!("`{path_text}`"),
            Some(code) => {
                if let Err(why) = self.has_name(path, code) {
                    return self.fault(range.start, format!("link to `{to}`: {why}"));
                }
                format!("`{code}` (`{path_text}`)")
            }
            None => format!("{text} (`{path_text}`)"),
        };
        self.edits.push((range, new));
    }

    fn has_name(&self, path: &Path, code: &str) -> Result<(), String> {
        if path.extension().is_none_or(|e| e != "rs") {
            return Ok(());
        }
        let text = std::fs::read_to_string(self.project.root.join(path))
            .map_err(|error| format!("`{}` cannot be read: {error}", shown(path)))?;
        let is_word = |sign: char| sign.is_alphanumeric() || sign == '_';
        let mut names = code.split("::").flat_map(|part| part.split(|sign| !is_word(sign)));
        let missing =
            names.find(|name| !text.split(|sign| !is_word(sign)).any(|word| word == *name));
        match missing.filter(|name| !name.is_empty()) {
            Some(name) => Err(format!("`{}` has no `{name}`", shown(path))),
            None => Ok(()),
        }
    }
}

/// A path as text, with `/`.
fn shown(path: &Path) -> String {
    let parts: Vec<_> = path.iter().map(|part| part.to_string_lossy()).collect();
    parts.join("/")
}

/// `folder/path` without `..`; `None` if that leaves the project.
pub fn joined(folder: &Path, path: &str) -> Option<PathBuf> {
    let mut out = PathBuf::new();
    for part in folder.join(path).components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir => {
                if !out.pop() {
                    return None;
                }
            }
            Component::Normal(name) => out.push(name),
            Component::RootDir | Component::Prefix(_) => return None,
        }
    }
    Some(out)
}
