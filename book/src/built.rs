//! The built book: whether its headings are those that links name, and whether it needs a network.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;

use crate::fault::Fault;
use crate::page::Anchor;

/// Tags that load what they name.
const LOADING: [&str; 10] =
    ["script", "link", "img", "iframe", "source", "video", "audio", "object", "embed", "base"];

/// Links to headings that the built pages do not have.
///
/// # Errors
/// If a page cannot be read.
pub fn lost_anchors(out: &Path, anchors: Vec<Anchor>) -> anyhow::Result<Vec<Fault>> {
    let mut faults = vec![];
    for Anchor { from, chapter, id } in anchors {
        let page = out.join(chapter.with_extension("html"));
        let html = fs::read_to_string(&page).with_context(|| page.display().to_string())?;
        if !html.contains(&format!(" id=\"{id}\"")) {
            faults.push(from);
        }
    }
    Ok(faults)
}

/// What pages and styles would load from a network.
///
/// # Errors
/// If a file cannot be read.
pub fn loads(out: &Path) -> anyhow::Result<Vec<Fault>> {
    let mut faults = vec![];
    for file in files(out)? {
        let extension = file.extension().and_then(|e| e.to_str()).unwrap_or_default();
        let found: fn(&str) -> Vec<&str> = match extension {
            "html" => loading_tags,
            "css" => loading_styles,
            _ => continue,
        };
        let text = fs::read_to_string(&file).with_context(|| file.display().to_string())?;
        let name = file.strip_prefix(out).unwrap_or(&file).display().to_string();
        faults.extend(found(&text).into_iter().map(|part| {
            let line =
                1 + text[..part.as_ptr() as usize - text.as_ptr() as usize].matches('\n').count();
            Fault { file: name.clone(), line, what: format!("loads from the network: `{part}`") }
        }));
    }
    Ok(faults)
}

fn is_remote(address: &str) -> bool {
    ["http://", "https://", "//"].iter().any(|scheme| address.starts_with(scheme))
}

fn loading_tags(html: &str) -> Vec<&str> {
    let tags = html.split('<').skip(1).filter_map(|tag| Some(tag.split_once('>')?.0));
    let loads = |tag: &&str| {
        let name = tag.split_whitespace().next().unwrap_or_default();
        LOADING.contains(&name) && tag.split(['"', '\'']).any(is_remote)
    };
    tags.filter(loads).collect()
}

fn loading_styles(css: &str) -> Vec<&str> {
    let first = |text: &'_ str| text.trim_start_matches(['"', '\'', ' ']).len();
    let addresses = css.split("url(").skip(1).chain(css.split("@import").skip(1));
    let addresses = addresses.map(|text| &text[text.len() - first(text)..]);
    let short = |text: &'_ str| text.find([')', ';', '"', '\'']).unwrap_or(text.len());
    addresses.filter(|text| is_remote(text)).map(|text| &text[..short(text)]).collect()
}

/// All files in a folder and below, in order.
fn files(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let mut found = vec![];
    let entries = fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    for entry in entries {
        let path = entry?.path();
        if path.is_dir() { found.extend(files(&path)?) } else { found.push(path) }
    }
    found.sort();
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_loads_from_a_network_is_seen() {
        let html = r#"<a href="https://a.org">x</a><script src="https://b.org/x.js"></script><img src='//c.org/p.png'><link href="own.css">"#;
        assert_eq!(loading_tags(html).len(), 2);
        let css = r#"@import "https://a.org/x.css"; a { background: url('http://b.org/p.png') } b { background: url(own.png) }"#;
        assert_eq!(loading_styles(css), ["http://b.org/p.png", "https://a.org/x.css"]);
    }
}
