//! `eplat plot DIR`: pictures for print of what a command left.

use std::collections::BTreeSet;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::json;

use super::voice::{Voice, stdout, tell};
use crate::ep::table::read_rows;
use crate::error::Failure;
use crate::report::plot::{
    OF_A_LOOP, OF_A_RUN, OF_VULNERABILITY, Picture, Style, Surrogate, Uncertainty, of_a_loop,
    of_a_run, of_vulnerability, surrogates,
};
use crate::run::{OutputFolder, hash_file};
use crate::study::{Table, pictures, summarise};
use crate::surrogate::{DEFAULT_FILTER, ErpRow, Valid, emulate_erp, fit_erp};

/// Names the pictures of a folder, and what they are of.
const RECORD: &str = "figures.json";
/// Kinds of pictures of a study, and of a folder with a table of strips.
const OF_A_STUDY: [&str; 2] = ["errors", "coverage"];
const OF_SURROGATES: [&str; 2] = ["cubic", "gp"];

/// `eplat plot DIR`
#[derive(Debug, Args)]
pub(super) struct Command {
    /// Output folder of `eplat run`, `eplat loop`, `eplat study run` or `eplat simulate atrium --s1s2`, or a folder with
    /// the table of strips that a surrogate was fitted to
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Folder of the pictures [default: DIR/figures]
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Only these kinds of pictures; of a run fields, truth, shares, predicted, traces; of a loop effects,
    /// residuals; of a study errors, coverage; of S1S2 at many sites vulnerability, activation; of surrogates cubic, gp
    #[arg(long, value_name = "KIND", num_args = 1.., value_delimiter = ',')]
    only: Vec<String>,
    /// How maps of a mean show where they are uncertain: a second map beside them, or fading to grey
    #[arg(long, value_enum, default_value_t = Shown::Beside)]
    uncertainty: Shown,
    /// Lines at every multiple of so many ms on maps in ms, such as 10 for isochrones
    #[arg(long, value_name = "MS", value_parser = step)]
    isochrones: Option<f64>,
    #[command(flatten)]
    pub(super) voice: Voice,
}

/// A step between lines, ms.
fn step(text: &str) -> Result<f64, String> {
    let step: Option<f64> = text.parse().ok().filter(|step| (0.1..1e6).contains(step));
    step.ok_or_else(|| "expected a number of ms, 0.1 or more".into())
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Shown {
    Beside,
    Opacity,
}

/// What a folder was left by.
enum Left {
    Run,
    Loop,
    Study,
    /// S1S2 at many sites.
    Vulnerability,
    /// The table of strips.
    Strips(PathBuf),
}

impl Left {
    fn of(folder: &Path) -> Result<Self, Failure> {
        let has = |name: &str| folder.join(name).is_file();
        if has("run.json") {
            return Ok(Self::Run);
        }
        if has("finding.json") {
            return Ok(Self::Loop);
        }
        if has("study.json") {
            return Ok(Self::Study);
        }
        if has("vulnerability.json") {
            return Ok(Self::Vulnerability);
        }
        strips(folder).map(Self::Strips).ok_or_else(|| {
            Failure::new(format_args!(
                "{}: nothing to draw; expected run.json (eplat run), finding.json (eplat loop), study.json (eplat study run), \
                 vulnerability.json (eplat simulate atrium --s1s2) or a table of strips (eplat surrogate run: columns tau_out_ms, apd_max_ms, erp_s2_ms, erp_s3_ms)\n\
                 help: name the --out folder of a finished command; run.json and finding.json are written last",
                folder.display()
            ))
        })
    }

    /// The file that everything drawn depends on, in `folder`.
    fn record(&self, folder: &Path) -> PathBuf {
        match self {
            Self::Run => folder.join("run.json"),
            Self::Loop => folder.join("finding.json"),
            Self::Study => folder.join("study.json"),
            Self::Vulnerability => folder.join("vulnerability.json"),
            Self::Strips(table) => table.clone(),
        }
    }

    fn kinds(&self) -> &'static [&'static str] {
        match self {
            Self::Run => &OF_A_RUN,
            Self::Loop => &OF_A_LOOP,
            Self::Study => &OF_A_STUDY,
            Self::Vulnerability => &OF_VULNERABILITY,
            Self::Strips(_) => &OF_SURROGATES,
        }
    }
}

/// The first CSV file by name that is a table of strips.
fn strips(folder: &Path) -> Option<PathBuf> {
    let entries = fs::read_dir(folder).ok()?.filter_map(|entry| Some(entry.ok()?.path()));
    let mut tables: Vec<PathBuf> =
        entries.filter(|path| path.extension().is_some_and(|e| e == "csv")).collect();
    tables.sort();
    tables.into_iter().find(|path| read_rows::<ErpRow>(path).is_ok())
}

/// The pictures that `new` ones do not replace: those that stay, for they are of what has this hash, too, and those
/// that go. Refuses what has the name of a new one and is not of eplat's making.
fn earlier(
    out: &OutputFolder,
    of: &str,
    new: &BTreeSet<String>,
) -> Result<[Vec<String>; 2], Failure> {
    let (record, own) = out.earlier(RECORD);
    let named: BTreeSet<&String> = own.iter().collect();
    let foreign = new.iter().filter(|name| !named.contains(name));
    out.refuse_foreign(foreign.map(String::as_str))?;
    let others = own.into_iter().filter(|name| !new.contains(name)).collect();
    Ok(if record["hash"] == of { [others, vec![]] } else { [vec![], others] })
}

impl Command {
    pub(super) fn run(&self) -> Result<(), Failure> {
        let left = Left::of(&self.folder)?;
        let kinds = left.kinds();
        if let Some(unknown) = self.only.iter().find(|kind| !kinds.contains(&kind.as_str())) {
            return Err(Failure::usage(format_args!(
                "--only {unknown}: no such kind of picture of {}\nhelp: there are {}",
                self.folder.display(),
                kinds.join(", ")
            )));
        }
        let out = self.out.clone().unwrap_or_else(|| self.folder.join("figures"));
        let out = OutputFolder::open(out)?;
        let of = hash_file(&left.record(&self.folder))?;
        let new = out.begin()?;
        let (mut drawn, mut names) = (vec![], BTreeSet::new());
        for kind in kinds {
            let is_wanted = self.only.is_empty() || self.only.iter().any(|only| only == kind);
            for picture in if is_wanted { self.pictures(&left, kind)? } else { vec![] } {
                picture.write(new.path()).map_err(|error| new.named(&out, error.into()))?;
                names.extend(picture.files());
                drawn.push((*kind, picture.files(), picture.shows));
            }
        }
        if drawn.is_empty() {
            return Err(Failure::new(format_args!(
                "{}: it has nothing of {}\nhelp: fields and truth need a model with fields (and, for truth, a synthetic \
                 experiment), predicted needs measurements, effects needs an effect of a column that was found",
                self.folder.display(),
                if self.only.is_empty() { kinds.join(", ") } else { self.only.join(", ") }
            )));
        }
        let [kept, gone] = earlier(&out, &of, &names)?;
        let record = json!({ "version": env!("CARGO_PKG_VERSION"), "of": self.folder, "hash": of });
        out.publish(&new, (RECORD, record), &kept, &gone)?;
        let written = drawn
            .into_iter()
            .map(|(kind, names, shows)| self.written(kind, &names.map(|n| out.file(&n)), &shows));
        let written = written.collect::<Result<Vec<_>, _>>()?;
        if self.voice.json {
            writeln!(stdout(), "{}", json!({ "pictures": written }))?;
        }
        Ok(())
    }

    /// Says that a picture was written: on stdout, one line for each of its files.
    fn written(
        &self,
        kind: &str,
        files: &[PathBuf; 2],
        shows: &str,
    ) -> Result<serde_json::Value, Failure> {
        if self.voice.json {
            let text = format!("{}, {}", files[0].display(), files[1].display());
            tell("written", text, json!({ "file": files[1], "shows": shows }));
        } else {
            let mut stdout = stdout();
            for file in files {
                writeln!(stdout, "{}  {shows}", file.display())?;
            }
        }
        Ok(json!({ "kind": kind, "shows": shows, "files": files }))
    }

    fn pictures(&self, left: &Left, kind: &str) -> Result<Vec<Picture>, Failure> {
        let uncertainty = match self.uncertainty {
            Shown::Beside => Uncertainty::Beside,
            Shown::Opacity => Uncertainty::Opacity,
        };
        let style = Style { uncertainty, isochrones: self.isochrones };
        Ok(match left {
            Left::Run => of_a_run(&self.folder, kind, style)?,
            Left::Loop => of_a_loop(&self.folder, kind)?,
            Left::Study => {
                let groups = summarise(&Table::read(&self.folder.join("results.csv"))?);
                pictures(&[(String::new(), groups)], kind)
            }
            Left::Vulnerability => of_vulnerability(&self.folder, kind)?,
            Left::Strips(table) => surrogates_of(table, kind)?.into(),
        })
    }
}

/// Both surrogates that `eplat surrogate fit` makes of a table, fitted again with its defaults.
fn surrogates_of(table: &Path, kind: &str) -> Result<[Picture; 2], Failure> {
    let rows: Vec<ErpRow> = read_rows(table)?.into_iter().map(|(_, row)| row).collect();
    let valid = Valid::of(&rows, &DEFAULT_FILTER);
    // above the range that was fitted both are void
    let drawn = |both: &dyn Fn(f64, f64) -> [f64; 2]| {
        let one = |which: usize| {
            move |t: f64, a: f64| {
                let both = both(t, a);
                (both[0] <= DEFAULT_FILTER.end).then_some(both[which])
            }
        };
        let [s2, s3] = [one(0), one(1)];
        let s2 = Surrogate { name: "ERP_S2", predict: &s2, strips: &valid.erp_s2 };
        let s3 = Surrogate { name: "ERP_S3", predict: &s3, strips: &valid.erp_s3 };
        surrogates(kind, &[s2, s3])
    };
    if kind == "gp" {
        let [s2, s3] = emulate_erp(&valid)?;
        return Ok(drawn(&|t, a| [s2.emulator.mean([t, a]), s3.emulator.mean([t, a])]));
    }
    let fit = fit_erp(&rows, &DEFAULT_FILTER)?;
    Ok(drawn(&|t, a| [fit.erp_s2.cubic.eval(t, a), fit.erp_s3.cubic.eval(t, a)]))
}
