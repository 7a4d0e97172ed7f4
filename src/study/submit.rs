//! Scripts that run a planned study on many machines, or on all cores of one: written, never started by themselves.
//!
//! The program knows nothing of a cluster: a shard is one command that writes one file, so any queue can run it. Shards
//! that lie there whole are not run again, which is what makes it safe to put a job back into the queue.

use std::path::Path;

use super::StudyError;
use super::shard::Plan;
use crate::base::files;

/// What runs the shards.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Engine {
    /// A job array of Slurm (<https://slurm.schedmd.com/job_array.html>).
    Slurm,
    /// Shell and xargs, as many at a time as there are cores.
    Local,
}

/// A script, by its name in the study's folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Script {
    /// File name.
    pub name: &'static str,
    /// Content.
    pub text: String,
}

/// Writes the scripts of a planned study into its folder; returns the command that starts them.
pub(crate) fn write(plan: &Plan, engine: Engine, shards: usize, folder: &Path) -> Result<String, StudyError> {
    let program =
        std::env::current_exe().map_err(|error| StudyError(format!("this program's own path: {error}")))?;
    let folder = folder.canonicalize().map_err(|error| StudyError::at(folder, error))?;
    let scripts = scripts(plan, engine, shards, &program, &folder);
    for script in &scripts {
        let path = folder.join(script.name);
        files::write_whole(&path, script.text.as_bytes()).map_err(|error| StudyError::at(&path, error))?;
    }
    Ok(format!("sh {}", folder.join(scripts[0].name).display()))
}

/// The scripts of a planned study; the first one starts the others. `program` and `folder` are absolute.
pub(crate) fn scripts(
    plan: &Plan,
    engine: Engine,
    shards: usize,
    program: &Path,
    folder: &Path,
) -> Vec<Script> {
    let shards = shards.clamp(1, plan.tasks.len().max(1));
    let program = quoted(program);
    let out = quoted(folder);
    let study = &plan.study;
    match engine {
        Engine::Local => vec![Script {
            name: "run-local.sh",
            text: format!(
                "#!/bin/sh\n\
                 # Runs the shards of the study {study} that are missing, one per core, then merges them.\n\
                 set -eu\n\
                 export RAYON_NUM_THREADS=1\n\
                 seq 1 {shards} | xargs -P \"$(getconf _NPROCESSORS_ONLN)\" -I INDEX \\\n    \
                 {program} study run {study} --out {out} --shard INDEX/{shards}\n\
                 {program} study merge {study} --out {out}\n"
            ),
        }],
        Engine::Slurm => vec![
            Script {
                name: "submit.sh",
                text: format!(
                    "#!/bin/sh\n\
                     # Puts the study {study} into Slurm's queue: an array of {shards} shards, then the merge.\n\
                     # Options for sbatch (partition, account, time) may follow: they are given to both jobs.\n\
                     set -eu\n\
                     array=$(sbatch --parsable \"$@\" {out}/shards.sbatch)\n\
                     merge=$(sbatch --parsable --dependency=afterok:\"$array\" \"$@\" {out}/merge.sbatch)\n\
                     echo \"shards: job $array, merge: job $merge\"\n"
                ),
            },
            Script {
                name: "shards.sbatch",
                text: format!(
                    "#!/bin/sh\n\
                     #SBATCH --job-name=outrigger-{study}\n\
                     #SBATCH --array=1-{shards}\n\
                     #SBATCH --cpus-per-task=1\n\
                     #SBATCH --requeue\n\
                     #SBATCH --open-mode=append\n\
                     #SBATCH --output={log}/shard-%a.log\n\
                     set -eu\n\
                     export RAYON_NUM_THREADS=\"${{SLURM_CPUS_PER_TASK:-1}}\"\n\
                     exec {program} study run {study} --out {out} --shard \"$SLURM_ARRAY_TASK_ID/{shards}\"\n",
                    log = folder.display(),
                ),
            },
            Script {
                name: "merge.sbatch",
                text: format!(
                    "#!/bin/sh\n\
                     #SBATCH --job-name=outrigger-{study}-merge\n\
                     #SBATCH --cpus-per-task=1\n\
                     #SBATCH --requeue\n\
                     #SBATCH --output={log}/merge.log\n\
                     set -eu\n\
                     exec {program} study merge {study} --out {out}\n",
                    log = folder.display(),
                ),
            },
        ],
    }
}

/// A path as one word of a shell.
fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/._-+".contains(c);
    if text.chars().all(is_plain) { text } else { format!("'{}'", text.replace('\'', "'\\''")) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::{Size, named};

    #[test]
    fn scripts_name_every_shard_and_quote_what_a_shell_would_read() {
        let size = Size { seeds: 1, quick: true, ..Size::default() };
        let plan = Plan::new(named("sensor-count").unwrap(), size).unwrap();
        let folder = Path::new("/data/it's here");
        let slurm = scripts(&plan, Engine::Slurm, 4, Path::new("/opt/outrigger"), folder);
        assert_eq!(slurm.len(), 3);
        assert!(slurm[0].text.contains("--dependency=afterok:"));
        assert!(slurm[1].text.contains("--array=1-4") && slurm[1].text.contains("--requeue"));
        assert!(slurm[1].text.contains("'/data/it'\\''s here'"), "{}", slurm[1].text);
        let local = scripts(&plan, Engine::Local, usize::MAX, Path::new("/opt/my tool"), folder);
        assert!(local[0].text.contains(&format!("seq 1 {}", plan.tasks.len())));
        assert!(local[0].text.contains("'/opt/my tool' study merge sensor-count"));
    }
}
