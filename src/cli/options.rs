//! The options of each command as data, for other ways to give them than a command line.

use clap::{ArgAction, CommandFactory as _};

use super::Cli;

/// An option of a command.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CommandOption {
    /// Its name without the two hyphens.
    pub name: String,
    /// What follows it.
    pub takes: Takes,
}

/// What follows an option.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Takes {
    /// Nothing: it is there or not.
    Flag,
    /// One value.
    Value,
    /// Values between commas.
    List,
    /// One value, and the option may be there several times.
    Repeated,
}

impl Takes {
    /// In one word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Flag => "flag",
            Self::Value => "value",
            Self::List => "list",
            Self::Repeated => "repeated",
        }
    }
}

/// The options of `command`, such as `run`; none if there is no such command.
pub fn options(command: &str) -> Vec<CommandOption> {
    let cli = Cli::command();
    let Some(command) = cli.find_subcommand(command) else { return vec![] };
    let option = |argument: &clap::Arg| {
        let takes = match argument.get_action() {
            ArgAction::Append if argument.get_value_delimiter().is_some() => Takes::List,
            ArgAction::Append => Takes::Repeated,
            ArgAction::Set => Takes::Value,
            _ => Takes::Flag,
        };
        Some(CommandOption { name: argument.get_long()?.to_owned(), takes })
    };
    command.get_arguments().filter_map(option).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_follows_an_option_is_known() {
        let run = options("run");
        let takes = |name: &str| run.iter().find(|o| o.name == name).map(|o| o.takes);
        assert_eq!(takes("chains"), Some(Takes::Value));
        assert_eq!(takes("prior"), Some(Takes::Flag));
        assert_eq!(takes("exceed"), Some(Takes::Repeated));
        assert_eq!(takes("nonsense"), None);
        assert!(options("no such command").is_empty());
    }
}
