//! What the rest of a model file declares beside its model: its functions, constants, types and imports.

use std::collections::BTreeSet;

use proc_macro2::TokenStream;
use syn::{Item, UseTree};

use crate::vocabulary::{PRELUDE, RUST, find};

/// The names that an expression of a model may mean and the model does not declare.
pub(crate) struct Around {
    /// Those that the file declares or imports by name.
    own: BTreeSet<String>,
    /// Whether there may be others: the file is not known, or it imports all of something.
    is_open: bool,
    /// Whether it has `use eplat::prelude::*;`, or imports `model`.
    pub(crate) has_prelude: bool,
}

impl Around {
    /// Of a model whose file is not known.
    pub(crate) fn unknown() -> Self {
        Self { own: BTreeSet::new(), is_open: true, has_prelude: true }
    }

    /// Of the file of these tokens. One that Rust cannot read is for rustc to complain about.
    pub(crate) fn of(tokens: &TokenStream) -> Self {
        let mut around = Self { own: BTreeSet::new(), is_open: false, has_prelude: false };
        match syn::parse2::<syn::File>(tokens.clone()) {
            Ok(file) => file.items.iter().for_each(|item| around.item(item)),
            Err(_) => return Self::unknown(),
        }
        around
    }

    /// Whether the name is, or may be, that of something outside the model.
    pub(crate) fn knows(&self, name: &str) -> bool {
        self.is_open || self.declares(name) || ships(name)
    }

    /// Whether the file declares or imports it by name, which hides what ships under that name.
    pub(crate) fn declares(&self, name: &str) -> bool {
        self.own.contains(name)
    }

    /// Whether there may be names of which nothing is known.
    pub(crate) fn is_open(&self) -> bool {
        self.is_open
    }

    /// The names that the file declares or imports.
    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        self.own.iter().map(String::as_str)
    }

    fn item(&mut self, item: &Item) {
        let name = match item {
            Item::Const(i) => &i.ident,
            Item::Enum(i) => &i.ident,
            Item::Fn(i) => &i.sig.ident,
            Item::Mod(i) => &i.ident,
            Item::Static(i) => &i.ident,
            Item::Struct(i) => &i.ident,
            Item::Trait(i) => &i.ident,
            Item::Type(i) => &i.ident,
            Item::Union(i) => &i.ident,
            Item::Use(i) => return self.import(&i.tree, &mut vec![]),
            Item::Macro(i) => return self.invocation(i),
            _ => return,
        };
        self.own.insert(name.to_string());
    }

    /// What a macro of the user's declares is not known.
    fn invocation(&mut self, item: &syn::ItemMacro) {
        let name = item.mac.path.segments.last().map(|last| last.ident.to_string());
        match name.as_deref() {
            Some("macro_rules") => {}
            Some("model") => self.has_prelude |= item.mac.path.segments.len() > 1,
            _ => self.is_open = true,
        }
    }

    fn import(&mut self, tree: &UseTree, path: &mut Vec<String>) {
        match tree {
            UseTree::Path(next) => {
                path.push(next.ident.to_string());
                self.import(&next.tree, path);
                path.pop();
            }
            UseTree::Group(group) => group.items.iter().for_each(|tree| self.import(tree, path)),
            UseTree::Glob(_) if path[..] == ["eplat", "prelude"] => self.has_prelude = true,
            UseTree::Glob(_) => self.is_open = true,
            UseTree::Name(name) => self.imported(&name.ident.to_string(), path),
            UseTree::Rename(name) => self.imported(&name.rename.to_string(), path),
        }
    }

    fn imported(&mut self, name: &str, path: &[String]) {
        self.has_prelude |= name == "model";
        // under its own name, what ships is what it is known as
        if path.first().is_none_or(|first| first != "eplat") || !ships(name) {
            self.own.insert(name.to_owned());
        }
    }
}

/// Whether eplat's prelude or Rust's has this name.
fn ships(name: &str) -> bool {
    find(name).is_some() || PRELUDE.contains(&name) || RUST.contains(&name)
}
