# SPDX-License-Identifier: Apache-2.0
"""The README's recipes for many machines, run by the real programs: GNU parallel, and Slurm on one node."""
import getpass
import os
import re
import shutil
import socket
import subprocess
import time
import unittest

from harness import BINARY, SOURCE, Case, write_exr

FILES = 10


def recipe(first_word):
    """The command of the README that begins with a word, its continued lines joined."""
    text = (SOURCE / "README.md").read_text().replace("\\\n", " ")
    return re.search(rf"^    ({first_word} .*)$", text, re.MULTILINE)[1]


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Cluster(Case):
    def setUp(self):
        super().setUp()
        for i in range(FILES):
            write_exr(self.path(f"{i}.exr"), 16, 8, lambda x, y: (x + i, y, i))
        self.path("list.txt").write_text("".join(f"{i}.exr\n" for i in range(FILES)))
        self.path("out").mkdir()
        self.run_tool("convert", "--files-from", "list.txt", "-o", "out/").is_silent()
        self.whole = self.outputs()
        self.assertEqual(len(self.whole), FILES)
        for name in self.whole:
            self.path("out/" + name).unlink()

    def outputs(self):
        return {name: self.path("out/" + name).read_bytes() for name in os.listdir(self.path("out"))}

    def run_recipe(self, command, **environment):
        env = {**os.environ, "PATH": os.path.dirname(BINARY) + ":" + os.environ["PATH"], "HOME": str(self.folder),
               **environment}
        done = subprocess.run(["sh", "-c", command], cwd=self.folder, capture_output=True, env=env, timeout=180)
        self.assertEqual(done.returncode, 0, (command, done.stdout, done.stderr))
        return done

    def test_gnu_parallel(self):
        self.run_recipe(recipe("parallel"))
        self.assertEqual(self.outputs(), self.whole)

    def test_slurm(self):
        environment = self.start_slurm()
        self.run_recipe(recipe("sbatch"), **environment)
        logs = "".join(p.read_text() for p in self.folder.glob("slurm-*.out"))
        self.assertEqual(self.outputs(), self.whole, logs)
        self.assertEqual(logs, "")  # every task was silent
        self.assertEqual(len(list(self.folder.glob("slurm-*.out"))), 4)

    def start_slurm(self):
        """A cluster of one node, this one, in the folder; the environment that makes Slurm's commands use it."""
        user, host = getpass.getuser(), socket.gethostname().split(".")[0]
        base = self.path("slurm")
        for name in ("state", "spool"):
            (base / name).mkdir(parents=True)
        key = base / "munge.key"
        key.write_bytes(os.urandom(1024))
        key.chmod(0o600)
        config = base / "slurm.conf"
        config.write_text(f"""
ClusterName=envconv
SlurmctldHost={host}(127.0.0.1)
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={base}/munge.socket
CredType=cred/munge
SlurmctldPort={free_port()}
SlurmdPort={free_port()}
StateSaveLocation={base}/state
SlurmdSpoolDir={base}/spool
SlurmctldPidFile={base}/slurmctld.pid
SlurmdPidFile={base}/slurmd.pid
SlurmctldLogFile={base}/slurmctld.log
SlurmdLogFile={base}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
JobCompType=jobcomp/none
ReturnToService=2
NodeName={host} NodeAddr=127.0.0.1 CPUs=2 State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
""")
        environment = {"SLURM_CONF": str(config)}
        env = {**os.environ, **environment}
        self.start(env, "munged", "--foreground", "--force", f"--socket={base}/munge.socket", f"--key-file={key}",
                   f"--pid-file={base}/munge.pid", f"--seed-file={base}/munge.seed", f"--log-file={base}/munge.log")
        self.wait_for(lambda: (base / "munge.socket").exists(), base)
        self.start(env, "slurmctld", "-D", "-i")
        self.start(env, "slurmd", "-D", "-N", host)
        self.wait_for(lambda: b"idle" in subprocess.run(["sinfo", "-h", "-o", "%T"], env=env, capture_output=True).stdout,
                      base)
        return environment

    def start(self, env, program, *words):
        found = shutil.which(program, path=os.environ["PATH"] + ":/usr/sbin:/sbin")
        self.assertTrue(found, f"{program} is missing (tools/setup.sh test installs it)")
        daemon = subprocess.Popen([found, *words], env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

        def stop():
            daemon.terminate()
            try:
                daemon.wait(timeout=10)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()

        self.addCleanup(stop)

    def wait_for(self, ready, base):
        for _ in range(600):
            if ready():
                return
            time.sleep(0.1)
        self.fail("".join(f"{log}:\n{log.read_text()}" for log in base.glob("*.log")))


if __name__ == "__main__":
    unittest.main()
