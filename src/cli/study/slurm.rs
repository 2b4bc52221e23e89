//! A plan as a Slurm job array.

use std::io::Write as _;
use std::path::Path;
use std::process::ExitCode;

use clap::Args;

use super::PlanArgs;
use crate::error::Failure;
use crate::store::write_file;

#[derive(Debug, Args)]
pub(in crate::cli) struct SlurmArgs {
    #[command(flatten)]
    plan: PlanArgs,
    /// Tasks of the array; each does its share of the truths on one core
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..))]
    tasks: u32,
    /// Time limit of a task, as sbatch takes it
    #[arg(long, value_name = "TIME", default_value = "01:00:00")]
    time: String,
}

impl SlurmArgs {
    /// Writes `array.sbatch`, `merge.sbatch` and `submit.sh` into the folder of the results.
    pub(super) fn run(&self) -> Result<ExitCode, Failure> {
        let (_, results) = self.plan.read()?;
        let absolute =
            |path: &Path| std::path::absolute(path).map_err(|e| Failure::io("find", path, &e));
        let (plan, out) = (absolute(&self.plan.plan)?, absolute(&self.plan.folder())?);
        let program = std::env::current_exe()
            .map_err(|e| Failure::new(format_args!("cannot tell where eplat is: {e}")))?;
        let [program, plan, out] = [program.as_path(), &plan, &out].map(quoted);
        let last = self.tasks - 1;
        let time = &self.time;
        let head = format!(
            "#!/bin/sh\n#SBATCH --cpus-per-task=1\n#SBATCH --time={time}\n#SBATCH --output={out}/slurm-%x-%A_%a.log\n"
        );
        let array = format!(
            "{head}#SBATCH --job-name=study\n#SBATCH --array=0-{last}\n\n\
             # Finished truths are skipped: submitted again, the array does what is missing.\n\
             exec {program} study run {plan} --out {out} --task \"$SLURM_ARRAY_TASK_ID/{}\" --threads 1\n",
            self.tasks
        );
        let merge = format!(
            "{head}#SBATCH --job-name=merge\n\n\
             # afterany: it starts also when tasks have failed, and refuses if truths are missing.\n\
             exec {program} study merge {plan} --out {out}\n"
        );
        let submit = format!(
            "#!/bin/sh\nset -e\narray=$(sbatch --parsable {out}/array.sbatch)\n\
             sbatch --dependency=afterany:\"$array\" {out}/merge.sbatch\n"
        );
        for (name, text) in
            [("array.sbatch", array), ("merge.sbatch", merge), ("submit.sh", submit)]
        {
            let path = results.file(name);
            write_file(&path, |file| std::io::Write::write_all(file, text.as_bytes()))
                .map_err(|error| Failure::io("write", &path, &error))?;
        }
        writeln!(std::io::stdout(), "sh {}", results.file("submit.sh").display())?;
        Ok(ExitCode::SUCCESS)
    }
}

/// For a shell; a path that would have to be escaped is quoted.
fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+".contains(c);
    if text.chars().all(is_plain) { text } else { format!("'{}'", text.replace('\'', r"'\''")) }
}
