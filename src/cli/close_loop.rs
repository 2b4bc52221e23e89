//! `eplat loop MODEL.rs`: what the model lacks, the model with it, and the error before and after.

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};

use super::compile::run_compiled;
use super::inputs::{InputArgs, Inputs, hash};
use super::interrupt;
use super::models::{Compiled, ModelFile};
use super::output::{Finished, OutputFolder, Sampled};
use super::run::record_of;
use super::sampling::{Job, every_chain_failed};
use crate::atomic::write_file;
use crate::criticism::{
    self, Case, Outcome, Predicted, Score, criticise, predict_rows, rewrite, score_of, with_heldout,
};
use crate::diagnostics::{quantile, standard_error};
use crate::dsl::{AddedEffect, Augmented, Declare, Measurements, Model, Sampler};
use crate::error::Failure;
use crate::infer::{self, Chain, jittered_starts};

/// Fewer sites than this cannot be criticised.
const LEAST_SITES: usize = 10;
/// Most draws that predictions are averaged over.
const PREDICTION_DRAWS: usize = 1000;

/// `eplat loop MODEL.rs`
#[derive(Debug, Args)]
pub(super) struct Command {
    /// Model file (.rs), for instance models/erp.rs
    model: PathBuf,
    #[command(flatten)]
    input: InputArgs,
    /// Measurements that play no part in the search: the error before and after is theirs; without
    /// lower and upper (or value) they are only predicted
    #[arg(long, value_name = "FILE.csv")]
    heldout: Option<PathBuf>,
    /// Output folder [default: out/NAME-loop, after the model file's name]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Searches on data simulated from the base fit: what a claim must beat
    #[arg(long, default_value_t = 99)]
    nulls: usize,
    /// Threads; 0 means one per core. Changes no number
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// Print finding.json on stdout
    #[arg(long)]
    json: bool,
}

/// A model that was sampled.
struct Sampling {
    model: Model,
    chains: Vec<Chain>,
    converged: bool,
}

impl Command {
    pub(super) fn run(&self, compiled: &[Compiled]) -> Result<ExitCode, Failure> {
        let begun = Instant::now();
        let file = ModelFile::read(&self.model)?;
        let Some(model) = file.find(compiled)? else { return run_compiled(&file) };
        if !self.input.has_data() {
            return Err(Failure::usage(
                "eplat loop criticises a model on measurements\nhelp: give them with --data FILE.csv",
            ));
        }
        let out = OutputFolder::open(&self.folder())?;
        let mut inputs = self.input.load(model)?;
        inputs.hashes.insert("model".into(), hash(&self.model)?);
        let heldout = self.heldout.as_deref().map(Measurements::read).transpose()?;
        check(&inputs.measurements, heldout.as_ref())?;
        let outcome = self.search(model, &inputs)?;
        let effects = added(model, &outcome, &inputs.measurements)?;
        let plain: Vec<AddedEffect> = effects.iter().map(|(effect, _)| effect.clone()).collect();
        let before = self.sample(model, &inputs, &out, "before")?;
        let augmented = Augmented::new(model, &plain);
        let after = match plain.is_empty() {
            true => None,
            false => Some(self.sample(&augmented, &inputs, &out, "after")?),
        };
        let mut story = Story { outcome: &outcome, effects: &effects, heldout: None };
        if let Some(heldout) = &heldout {
            story.heldout =
                Some(self.predict(model, &augmented, &inputs, heldout, &before, after.as_ref())?);
        }
        let finding = story.finding(&inputs.measurements, after.as_ref());
        let mut files = vec![];
        if !plain.is_empty() {
            let name = file_name(&self.model, &plain);
            let text = rewrite(&file.source, &effects).ok_or_else(|| {
                Failure::new(format_args!(
                    "{}: no `model! {{ … }}` to add to",
                    self.model.display()
                ))
            })?;
            save(&out, &name, &text)?;
            files.push(name);
        }
        if let Some(heldout) = &story.heldout {
            save(&out, "heldout_predictions.csv", &heldout.csv())?;
            files.push("heldout_predictions.csv".into());
        }
        save(&out, "finding.json", &format!("{finding:#}\n"))?;
        files.push("finding.json".into());
        let mut stdout = std::io::stdout().lock();
        if self.json {
            writeln!(stdout, "{finding:#}")?;
        } else {
            let text = story.text(&finding);
            writeln!(
                stdout,
                "\n{text}\nwrote {} to {} in {:.1} s",
                files.join(", "),
                out.path().display(),
                begun.elapsed().as_secs_f64()
            )?;
        }
        let converged = before.converged && after.as_ref().is_none_or(|after| after.converged);
        Ok(if converged { ExitCode::SUCCESS } else { ExitCode::from(3) })
    }

    fn folder(&self) -> PathBuf {
        let stem = self.model.file_stem().unwrap_or("model".as_ref()).display();
        self.out.clone().unwrap_or_else(|| Path::new("out").join(format!("{stem}-loop")))
    }

    fn search(&self, model: &dyn Declare, inputs: &Inputs) -> Result<Outcome, Failure> {
        let basis = inputs.surface.as_ref().map(|(_, basis)| basis);
        let case = Case { model, basis, table: &inputs.measurements };
        let settings = criticism::Settings {
            nulls: self.nulls,
            seed: self.input.seed,
            ..criticism::Settings::default()
        };
        let bar = ProgressBar::new(self.nulls as u64).with_style(
            ProgressStyle::with_template(
                "search round {msg} {bar:24} {pos:>3}/{len} simulated, ETA {eta}",
            )
            .unwrap_or_else(|_| ProgressStyle::default_bar()),
        );
        let watch = |round: usize, done: usize| {
            bar.set_message((round + 1).to_string());
            bar.set_position(done as u64);
        };
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(self.threads)
            .build()
            .map_err(|error| Failure::new(format_args!("cannot start threads: {error}")))?;
        let outcome = pool.install(|| criticise(&case, &settings, &watch))?;
        bar.finish_and_clear();
        Ok(outcome)
    }

    /// Samples a model into its own folder.
    fn sample(
        &self,
        declared: &dyn Declare,
        inputs: &Inputs,
        out: &OutputFolder,
        name: &str,
    ) -> Result<Sampling, Failure> {
        let begun = Instant::now();
        let basis = inputs.surface.as_ref().map(|(_, basis)| basis);
        let model = Model::new(declared, basis, &inputs.measurements)?;
        let settings = infer::Settings {
            seed: self.input.seed,
            threads: self.threads,
            ..infer::Settings::default()
        };
        let sampler = Sampler::of(&model);
        let starts = jittered_starts(&model, &model.initial(), settings.chains, settings.seed)?;
        let folder = OutputFolder::open(&out.file(name))?;
        let mut finished = Finished {
            model: &model,
            inputs,
            sampled: Sampled::default(),
            seed: settings.seed,
            settings: record_of(&settings, sampler.name()),
            compile_seconds: 0.0,
            begun,
        };
        let every = Duration::from_secs(2);
        let opened = interrupt::open(&folder, finished.identity(), &starts, false, every)?;
        let Some(checkpoint) = opened else { unreachable!("a run that begins is not complete") };
        let job = Job { model: &model, sampler, settings: &settings, starts: &starts, begun };
        let (sampled, checkpoint) = job.sample(checkpoint)?;
        checkpoint.remove()?;
        let sampled = sampled.ok_or_else(|| Failure::new("interrupted"))?;
        if sampled.chains.is_empty() {
            return Err(every_chain_failed(&sampled.failures));
        }
        finished.sampled = sampled;
        let converged = finished.write(&folder)?.converged();
        let chains = std::mem::take(&mut finished.sampled.chains);
        drop(finished);
        Ok(Sampling { model, chains, converged })
    }

    /// Predicts the held-out rows by both fits.
    fn predict(
        &self,
        model: &dyn Declare,
        augmented: &dyn Declare,
        inputs: &Inputs,
        heldout: &Measurements,
        before: &Sampling,
        after: Option<&Sampling>,
    ) -> Result<Heldout, Failure> {
        let own: Vec<&str> = before.model.observes.iter().map(|o| o.name).collect();
        let mut table = with_heldout(&inputs.measurements, heldout, &own);
        table.check_protocols(&own)?;
        if let Some((surface, _)) = &inputs.surface {
            table.place_on(surface, self.input.scale())?;
        }
        let basis = inputs.surface.as_ref().map(|(_, basis)| basis);
        let first = inputs.measurements.len();
        let predict = |declared: &dyn Declare, fit: &Sampling| -> Result<Vec<Predicted>, Failure> {
            let all = Model::new(declared, basis, &table)?;
            let draws = thinned(&fit.chains);
            Ok(predict_rows(&all, &fit.model, &draws, first, self.input.seed))
        };
        let before = predict(model, before)?;
        let after = after.map(|fit| predict(augmented, fit)).transpose()?;
        let measured = ["lower", "upper", "value"].into_iter().chain(own);
        let measured: Vec<&str> = measured.filter(|c| heldout.has(c)).collect();
        let is_measured = |row: usize| {
            measured.iter().any(|c| heldout.cell(row, c).is_some_and(|cell| !cell.is_empty()))
        };
        let is_measured = (0..heldout.len()).map(is_measured).collect();
        let cell = |row: usize, name: &str| heldout.cell(row, name).unwrap_or_default().to_owned();
        let names =
            (0..heldout.len()).map(|row| [cell(row, "site"), cell(row, "protocol")]).collect();
        Ok(Heldout { first, before, after, is_measured, names })
    }
}

/// At most [`PREDICTION_DRAWS`] draws, evenly from all chains.
fn thinned(chains: &[Chain]) -> Vec<&[f64]> {
    let n: usize = chains.iter().map(Chain::n_draws).sum();
    let every = n.div_ceil(PREDICTION_DRAWS).max(1);
    let all = chains.iter().flat_map(|chain| (0..chain.n_draws()).map(|i| chain.draw(i)));
    all.step_by(every).collect()
}

/// Complains about tables that cannot be criticised.
fn check(train: &Measurements, heldout: Option<&Measurements>) -> Result<(), Failure> {
    let sites = |table: &Measurements| -> BTreeMap<String, usize> {
        let column = ["site", "vertex"].into_iter().find(|c| train.has(c));
        let site = |row| match column {
            Some(column) => table.cell(row, column).unwrap_or_default().to_owned(),
            None => row.to_string(),
        };
        (0..table.len()).map(|row| (site(row), row)).collect()
    };
    let own = sites(train);
    if own.len() < LEAST_SITES {
        return Err(Failure::new(format_args!(
            "{}: {} sites; at least {LEAST_SITES} are needed to tell an effect from chance\nhelp: measure at more sites",
            train.file(),
            own.len()
        )));
    }
    let Some(heldout) = heldout else { return Ok(()) };
    if !train.has("site") && !train.has("vertex") {
        return Ok(());
    }
    if let Some((site, row)) = sites(heldout).into_iter().find(|(site, _)| own.contains_key(site)) {
        return Err(Failure::new(format_args!(
            "{}, line {}: site {site} is also in {}: it would be predicted from itself\nhelp: hold out whole sites",
            heldout.file(),
            heldout.line(row),
            train.file()
        )));
    }
    Ok(())
}

/// What was found as effects with names of their own, and why each is there.
fn added(
    model: &dyn Declare,
    outcome: &Outcome,
    table: &Measurements,
) -> Result<Vec<(AddedEffect, String)>, Failure> {
    let outline = Model::outline(model)?;
    let unit_of = |name: &str| {
        let statement = outline.statements.iter().find(|s| s.decl.name == name);
        statement.map(|s| s.decl.unit.to_owned()).unwrap_or_default()
    };
    let mut effects: Vec<(AddedEffect, String)> = vec![];
    for (round, candidate) in outcome.found.iter().enumerate() {
        let found = &outcome.candidates[*candidate];
        let is_taken = |name: &str, effects: &[(AddedEffect, String)]| {
            outline.statements.iter().any(|s| s.decl.name == name)
                || effects.iter().any(|(e, _)| e.name == name)
        };
        let mut name = found.name.clone();
        while is_taken(&name, &effects) {
            name += "_effect";
        }
        let log_bf = outcome.rounds[round].tried.first().map_or(f64::NAN, |t| t.log_bf);
        let why =
            format!("Found by `eplat loop` in {}: log Bayes factor {log_bf:.1}.", table.file());
        let (on, form, sd) = (found.on.clone(), found.form.clone(), found.sd);
        let unit = unit_of(&on[0]);
        effects.push((AddedEffect { name, on, unit, form, sd }, why));
    }
    Ok(effects)
}

fn file_name(model: &Path, effects: &[AddedEffect]) -> String {
    let stem = model.file_stem().unwrap_or("model".as_ref()).display().to_string();
    let names: Vec<&str> = effects.iter().map(|e| e.name.as_str()).collect();
    format!("{stem}_plus_{}.rs", names.join("_"))
}

fn save(out: &OutputFolder, name: &str, text: &str) -> Result<(), Failure> {
    out.make()?;
    let path = out.file(name);
    write_file(&path, |file| file.write_all(text.as_bytes()))
        .map_err(|error| Failure::io("write", &path, &error))
}

/// Predictions of held-out rows.
struct Heldout {
    /// Row of the joint table of the first held-out row.
    first: usize,
    before: Vec<Predicted>,
    after: Option<Vec<Predicted>>,
    is_measured: Vec<bool>,
    /// Site and protocol.
    names: Vec<[String; 2]>,
}

impl Heldout {
    fn csv(&self) -> String {
        let mut lines: BTreeMap<usize, String> = BTreeMap::new();
        let after = self.after.as_ref().unwrap_or(&self.before);
        for (b, a) in self.before.iter().zip(after) {
            let row = b.table_row - self.first;
            let [site, protocol] = &self.names[row];
            lines.insert(row, format!("{site},{protocol},{:.4},{:.4}\n", b.value, a.value));
        }
        let header = "site,protocol,before,after\n".to_owned();
        lines.into_values().fold(header, |csv, line| csv + &line)
    }

    /// Scores before and after, and the gain in elpd with its standard error; `None` unless measured.
    fn scores(&self) -> Option<(Score, Score, f64, f64)> {
        let measured = |all: &[Predicted]| -> Vec<Predicted> {
            all.iter().filter(|p| self.is_measured[p.table_row - self.first]).cloned().collect()
        };
        let before = measured(&self.before);
        let after = self.after.as_deref().map_or_else(|| before.clone(), measured);
        if before.is_empty() {
            return None;
        }
        let gains: Vec<f64> =
            after.iter().zip(&before).map(|(a, b)| a.ln_density - b.ln_density).collect();
        let (b, a) = (score_of(&before), score_of(&after));
        Some((b, a, gains.iter().sum(), standard_error(&gains)))
    }

    fn json(&self) -> Value {
        let Some((before, after, gain, se)) = self.scores() else { return Value::Null };
        json!({
            "n": before.n,
            "rmse_before": before.rmse, "rmse_after": after.rmse,
            "elpd_before": before.elpd, "elpd_after": after.elpd,
            "elpd_gain": gain, "elpd_gain_se": se,
            "coverage90_before": before.coverage90, "coverage90_after": after.coverage90,
        })
    }
}

/// What there is to tell.
struct Story<'a> {
    outcome: &'a Outcome,
    effects: &'a [(AddedEffect, String)],
    heldout: Option<Heldout>,
}

impl Story<'_> {
    fn finding(&self, table: &Measurements, after: Option<&Sampling>) -> Value {
        let outcome = self.outcome;
        let names: Vec<&str> =
            outcome.found.iter().map(|f| outcome.candidates[*f].name.as_str()).collect();
        let intervals: BTreeMap<&str, Value> = names
            .iter()
            .zip(self.effects)
            .filter_map(|(name, (effect, _))| Some((*name, interval(effect, after?)?)))
            .collect();
        let tried: Vec<Value> = outcome
            .rounds
            .iter()
            .enumerate()
            .flat_map(|(round, r)| r.tried.iter().map(move |t| (round, t)))
            .map(|(round, t)| {
                let candidate = &outcome.candidates[t.candidate];
                json!({
                    "round": round + 1,
                    "effect": candidate.name,
                    "on": candidate.on,
                    "form": candidate.form.text(),
                    "p_screen": t.p_screen,
                    "log_bf": t.log_bf.is_finite().then_some(t.log_bf),
                    "p_null": t.p_null,
                    "verdict": t.verdict,
                })
            })
            .collect();
        let unusable: Vec<Value> =
            outcome.unusable.iter().map(|u| json!({ "column": u.column, "why": u.why })).collect();
        json!({
            "findings": names,
            "ambiguous": outcome.ambiguous,
            "unexplained": outcome.is_unexplained(),
            "effect_interval": intervals,
            "heldout": self.heldout.as_ref().map_or(Value::Null, Heldout::json),
            "data": table.file(),
            "nulls": outcome.rounds.iter().map(|r| r.nulls.clone()).collect::<Vec<_>>(),
            "site_log_bf": outcome.site_log_bf,
            "not_tried": unusable,
            "tried": tried,
        })
    }

    /// The verdict in a few sentences.
    fn text(&self, finding: &Value) -> String {
        let outcome = self.outcome;
        let mut lines = vec![];
        for (effect, _) in self.effects {
            lines.push(format!("found     {}", effect.statement()));
        }
        for [a, b] in &outcome.ambiguous {
            lines.push(format!("ambiguous {a} or {b}: these data cannot tell"));
        }
        if lines.is_empty() {
            lines.push("found     nothing that the model lacks".into());
        }
        if outcome.is_unexplained() {
            lines.push(format!(
                "remains   sites differ by more than the model says (log Bayes factor {:.1}), for a reason that is not among the columns",
                outcome.site_log_bf
            ));
        }
        let heldout = &finding["heldout"];
        if let (Some(before), Some(after)) =
            (heldout["rmse_before"].as_f64(), heldout["rmse_after"].as_f64())
        {
            let of = |name: &str| heldout[name].as_f64().unwrap_or(f64::NAN);
            lines.push(format!(
                "held out  rmse {before:.2} → {after:.2}, elpd {:+.1} ± {:.1}, 90 % intervals cover {:.0} → {:.0} %",
                of("elpd_gain"),
                of("elpd_gain_se"),
                100.0 * of("coverage90_before"),
                100.0 * of("coverage90_after")
            ));
        }
        lines.join("\n")
    }
}

/// Central 90 % interval of an effect's coefficient, or of the greatest difference between two of its
/// coefficients.
fn interval(effect: &AddedEffect, after: &Sampling) -> Option<Value> {
    let names = after.model.unknown_names();
    let own: Vec<usize> = (0..names.len())
        .filter(|i| names[*i].split('[').next() == Some(effect.name.as_str()))
        .collect();
    let draws = thinned(&after.chains);
    let column = |i: usize| -> Vec<f64> { draws.iter().map(|draw| draw[i]).collect() };
    let mean = |i: usize| column(i).iter().sum::<f64>() / draws.len() as f64;
    let mut values = match own[..] {
        [] => return None,
        [one] => column(one),
        _ => {
            let by_mean = |a: &&usize, b: &&usize| mean(**a).total_cmp(&mean(**b));
            let (low, high) = (own.iter().min_by(by_mean)?, own.iter().max_by(by_mean)?);
            draws.iter().map(|draw| draw[*high] - draw[*low]).collect()
        }
    };
    values.sort_by(f64::total_cmp);
    Some(json!([quantile(&values, 0.05), quantile(&values, 0.95)]))
}
