//! The Slurm script of the bake, on a cluster of this machine alone: the bytes of a bake in one go.

#![allow(clippy::unwrap_used)]

use relume_tests::files::{fresh_folder, names};
use relume_tests::program::{bake_in, relume_bake};
use relume_tests::scene::write_courtyard;
use relume_tests::skip::skip;
use relume_tests::slurm::Cluster;
use std::path::Path;
use std::time::Duration;

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../bake/slurm/bake.sbatch");
const BAKE: [&str; 10] =
    ["scene.glb", "--camera", "camera.json", "--size", "128x90", "--directions", "16", "--sun-paths", "8", "-o"];
const LONGEST: Duration = Duration::from_secs(90);

/// Submits the script in `folder`; the job's number.
fn submit(cluster: &Cluster, folder: &Path, options: &[&str], args: &[&str]) -> String {
    let mut command = cluster.command("sbatch");
    command.args(["--parsable", "--kill-on-invalid-dep=yes"]).args(options).arg(SCRIPT).args(args).current_dir(folder);
    command.env("RELUME_BAKE", relume_bake().get_program());
    let out = command.output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    String::from_utf8_lossy(&out.stdout).trim().to_owned()
}

fn logs(folder: &Path) -> String {
    let logs = names(folder).into_iter().filter(|name| name.ends_with(".log"));
    logs.map(|name| std::fs::read_to_string(folder.join(name)).unwrap()).collect()
}

#[test]
fn a_job_array_bakes_the_field_of_one_bake() {
    let cluster = match Cluster::start() {
        Ok(cluster) => cluster,
        Err(why) => return skip("the bake as a Slurm job array", &why),
    };
    let folder = fresh_folder(env!("CARGO_TARGET_TMPDIR"), "slurm");
    write_courtyard(&folder);
    bake_in(&folder, &[&["scene"][..], &BAKE, &["whole.field"]].concat()).well();
    bake_in(&folder, &[&["plan"][..], &BAKE, &["plan.toml"]].concat()).well();

    // 12 tiles; the array's numbers need not begin at 0.
    let bake = submit(&cluster, &folder, &["--array=3-7", "--cpus-per-task=1"], &["plan.toml"]);
    let join = format!("--dependency=afterok:{bake}");
    submit(&cluster, &folder, &[&join], &["plan.toml", "joined.field"]);
    cluster.wait_for_jobs(LONGEST).unwrap();
    let shares = names(&folder.join("plan.shares"));
    assert_eq!(
        shares,
        ["000000.share", "000002.share", "000004.share", "000007.share", "000009.share"],
        "{}",
        logs(&folder)
    );
    let bytes =
        |name: &str| std::fs::read(folder.join(name)).unwrap_or_else(|fault| panic!("{fault}: {}", logs(&folder)));
    assert!(bytes("joined.field") == bytes("whole.field"), "the bytes differ");

    // A share that is lost, and one that was killed half-way, are baked again by the same line; the others are left alone.
    let share = |name: &str| folder.join("plan.shares").join(name);
    let whole = std::fs::read(share("000004.share")).unwrap();
    std::fs::write(share("000004.share.part"), &whole[..whole.len() - 9]).unwrap();
    std::fs::remove_file(share("000004.share")).unwrap();
    std::fs::remove_file(share("000009.share")).unwrap();
    let kept = std::fs::metadata(share("000000.share")).unwrap().modified().unwrap();
    submit(&cluster, &folder, &["--array=0-4", "--cpus-per-task=1"], &["plan.toml"]);
    cluster.wait_for_jobs(LONGEST).unwrap();
    assert_eq!(names(&folder.join("plan.shares")), shares, "{}", logs(&folder));
    assert!(std::fs::read(share("000004.share")).unwrap() == whole, "the share differs");
    assert_eq!(std::fs::metadata(share("000000.share")).unwrap().modified().unwrap(), kept);
}
