//! A Slurm cluster of this machine alone: its own `munged`, `slurmctld` and `slurmd`, in a folder and on ports of their own.

use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Programs of Debian's packages munge, slurmctld, slurmd and slurm-client, and one that ends daemons whose test is killed.
const PROGRAMS: [&str; 6] = ["munged", "slurmctld", "slurmd", "sbatch", "squeue", "setpriv"];
/// How long daemons may take to answer.
const START: Duration = Duration::from_secs(20);

/// A running cluster; its daemons end with it.
pub struct Cluster {
    folder: TempDir,
    daemons: Vec<Child>,
}

impl Cluster {
    /// Starts one.
    ///
    /// # Errors
    /// Why there is none, in a line.
    pub fn start() -> Result<Self, String> {
        let has = |name: &&str| ["/usr/sbin", "/usr/bin", "/bin"].iter().any(|dir| Path::new(dir).join(name).exists());
        if let Some(program) = PROGRAMS.iter().find(|name| !has(name)) {
            return Err(format!("needs {program} (munge slurmctld slurmd slurm-client)"));
        }
        // Sockets' names are short: not in the target folder, however deep that lies.
        let folder = tempfile::Builder::new().prefix("relume-slurm-").tempdir().map_err(|fault| fault.to_string())?;
        let mut cluster = Cluster { folder, daemons: Vec::new() };
        cluster.configure().map_err(|fault| fault.to_string())?;
        let at = |name: &str| cluster.folder.path().join(name).display().to_string();
        let files =
            ["key-file", "socket", "pid-file", "log-file", "seed-file"].map(|file| format!("--{file}={}", at(file)));
        cluster.daemon("munged", &[&["--foreground".to_owned()][..], &files].concat())?;
        cluster.wait("munged", |cluster| cluster.folder.path().join("socket").exists())?;
        cluster.daemon("slurmctld", &["-D", "-i"].map(str::to_owned))?;
        cluster.daemon("slurmd", &["-D", "-N", "relume"].map(str::to_owned))?;
        cluster.wait("slurmd", |cluster| {
            cluster.ask("sinfo", &["-h", "-o", "%T"]).is_ok_and(|told| told.trim() == "idle")
        })?;
        Ok(cluster)
    }

    /// Writes keys and `slurm.conf`.
    fn configure(&self) -> std::io::Result<()> {
        let folder = self.folder.path();
        std::fs::set_permissions(folder, std::fs::Permissions::from_mode(0o755))?;
        let key: Vec<u8> = std::fs::read("/proc/sys/kernel/random/uuid")?.repeat(4);
        std::fs::write(folder.join("key-file"), key)?;
        std::fs::set_permissions(folder.join("key-file"), std::fs::Permissions::from_mode(0o600))?;
        for name in ["state", "spool"] {
            std::fs::create_dir(folder.join(name))?;
        }
        let told = |program: &str, option: &str| -> std::io::Result<String> {
            Ok(String::from_utf8_lossy(&Command::new(program).arg(option).output()?.stdout).trim().to_owned())
        };
        let (host, user, here) = (told("hostname", "-s")?, told("id", "-un")?, folder.display());
        let listeners = [TcpListener::bind("127.0.0.1:0")?, TcpListener::bind("127.0.0.1:0")?];
        let [control, node] = [listeners[0].local_addr()?.port(), listeners[1].local_addr()?.port()];
        let cpus = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        let text = format!(
            "ClusterName=relume\nSlurmctldHost={host}(127.0.0.1)\nSlurmUser={user}\nSlurmdUser={user}\n\
             SlurmctldPort={control}\nSlurmdPort={node}\nAuthType=auth/munge\nAuthInfo=socket={here}/socket\n\
             StateSaveLocation={here}/state\nSlurmdSpoolDir={here}/spool\n\
             SlurmctldPidFile={here}/slurmctld.pid\nSlurmdPidFile={here}/slurmd.pid\n\
             SlurmctldLogFile={here}/slurmctld.log\nSlurmdLogFile={here}/slurmd.log\n\
             ProctrackType=proctrack/linuxproc\nTaskPlugin=task/none\nJobAcctGatherType=jobacct_gather/none\n\
             SelectType=select/cons_tres\nSelectTypeParameters=CR_CPU\nMpiDefault=none\nReturnToService=2\n\
             SlurmdParameters=config_overrides\nSchedulerType=sched/builtin\n\
             SchedulerParameters=sched_interval=1,batch_sched_delay=0\n\
             NodeName=relume NodeHostname={host} NodeAddr=127.0.0.1 CPUs={cpus}\n\
             PartitionName=all Nodes=ALL Default=YES\n"
        );
        std::fs::write(folder.join("slurm.conf"), text)
    }

    fn daemon(&mut self, program: &str, args: &[String]) -> Result<(), String> {
        // A test that is killed takes its daemons along.
        let mut command = self.command("setpriv");
        command.args(["--pdeathsig", "KILL", program]).args(args).stdin(Stdio::null());
        let log =
            std::fs::File::create(self.folder.path().join(format!("{program}.err"))).map_err(|e| e.to_string())?;
        command.stdout(Stdio::null()).stderr(log);
        self.daemons.push(command.spawn().map_err(|fault| format!("{program}: {fault}"))?);
        Ok(())
    }

    /// A command that speaks to this cluster.
    pub fn command(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        command.env("SLURM_CONF", self.folder.path().join("slurm.conf"));
        command.env("PATH", "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin");
        command
    }

    /// What such a command says on standard output.
    ///
    /// # Errors
    /// What it says on standard error when it fails.
    pub fn ask(&self, program: &str, args: &[&str]) -> Result<String, String> {
        let out = self.command(program).args(args).output().map_err(|fault| format!("{program}: {fault}"))?;
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim().to_owned();
        if out.status.success() { Ok(text(&out.stdout)) } else { Err(format!("{program}: {}", text(&out.stderr))) }
    }

    fn wait(&mut self, program: &str, is_up: impl Fn(&Self) -> bool) -> Result<(), String> {
        let started = Instant::now();
        while !is_up(self) {
            let ended = self.daemons.iter_mut().any(|child| !matches!(child.try_wait(), Ok(None)));
            if ended || started.elapsed() > START {
                return Err(format!("{program} did not start: {}", self.last_words()));
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        Ok(())
    }

    /// The last line of each daemon's log.
    pub fn last_words(&self) -> String {
        let logs = ["munged.err", "slurmctld.err", "slurmctld.log", "slurmd.err", "slurmd.log"];
        let last =
            |name: &str| std::fs::read_to_string(self.folder.path().join(name)).ok()?.lines().last().map(str::to_owned);
        logs.iter().filter_map(|name| last(name)).collect::<Vec<_>>().join("; ")
    }

    /// Waits until no job is left.
    ///
    /// # Errors
    /// They take longer than `most`.
    pub fn wait_for_jobs(&self, most: Duration) -> Result<(), String> {
        let started = Instant::now();
        loop {
            let left = self.ask("squeue", &["-h"])?;
            if left.is_empty() {
                return Ok(());
            }
            if started.elapsed() > most {
                return Err(format!("after {most:?} there are jobs left: {left}; {}", self.last_words()));
            }
            std::thread::sleep(Duration::from_millis(100));
        }
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        // Jobs run in processes of their own; those that are left end before their node.
        if self.daemons.len() == 3 && self.ask("squeue", &["-h"]).is_ok_and(|left| !left.is_empty()) {
            let _ = self.ask("scancel", &["--partition=all", "--signal=KILL", "--full"]);
            let _ = self.ask("scancel", &["--partition=all"]);
            let _ = self.wait_for_jobs(Duration::from_secs(3));
        }
        for mut daemon in self.daemons.drain(..).rev() {
            let _ = daemon.kill();
            let _ = daemon.wait();
        }
    }
}
