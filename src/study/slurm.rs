//! A plan as a Slurm job array.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use super::{Results, StudyError};
use crate::store::write_file;

/// The job array that does a plan.
#[derive(Clone, Debug)]
pub struct JobArray {
    /// The program `eplat`, as the nodes find it.
    pub program: PathBuf,
    /// The plan.
    pub plan: PathBuf,
    /// Tasks of the array; each does its share of the truths on one core.
    pub tasks: u32,
    /// Time limit of a task, as sbatch takes it.
    pub time: String,
}

impl JobArray {
    /// The files that it writes.
    pub(super) const FILES: [&str; 3] = ["array.sbatch", "merge.sbatch", "submit.sh"];

    /// Writes `array.sbatch`, `merge.sbatch` and `submit.sh` into the folder of the results; the path of
    /// the last, which submits both.
    ///
    /// # Errors
    /// [`StudyError::Write`].
    pub fn write(&self, results: &Results) -> Result<PathBuf, StudyError> {
        let absolute = |path: &Path| std::path::absolute(path).map_err(StudyError::io(path));
        let (plan, out) = (absolute(&self.plan)?, absolute(results.folder())?);
        let [program, plan, out] = [self.program.as_path(), &plan, &out].map(quoted);
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
        for (name, text) in Self::FILES.into_iter().zip([array, merge, submit]) {
            let path = results.file(name);
            write_file(&path, |file| file.write_all(text.as_bytes()))
                .map_err(StudyError::io(&path))?;
        }
        Ok(results.file("submit.sh"))
    }
}

/// For a shell; a path that would have to be escaped is quoted.
fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+".contains(c);
    if text.chars().all(is_plain) { text } else { format!("'{}'", text.replace('\'', r"'\''")) }
}
