# SPDX-License-Identifier: Apache-2.0
"""Committed documents are what the program prints today; completions complete."""
import re
import shutil
import subprocess
import unittest

from harness import BINARY, PANORAMAS, SOURCE, Case


class Documents(Case):
    def check(self, kind, template, committed):
        fresh = self.run_tool("--generate", kind, SOURCE / template).out
        self.assertEqual(fresh, (SOURCE / committed).read_text(), f"{committed} is stale: run tools/generate.sh")

    def test_manual(self):
        self.check("man", "man/envconv.1.in", "man/envconv.1")
        self.check("layouts-man", "man/envconv-layouts.7.in", "man/envconv-layouts.7")
        self.check("metrics-man", "man/envconv-metrics.7.in", "man/envconv-metrics.7")

    def test_readme(self):
        self.check("readme", "README.md", "README.md")

    def test_manual_is_good_roff(self):
        for page in ("man/envconv.1", "man/envconv-layouts.7", "man/envconv-metrics.7"):
            done = subprocess.run(["man", "--warnings", "-E", "UTF-8", "-l", "-Tutf8", "-Z", SOURCE / page],
                                  capture_output=True, text=True)
            self.assertEqual((done.returncode, done.stderr), (0, ""))

    def test_references_that_lead_nowhere_are_found(self):
        self.path("page.in").write_text("see \\fB\\-\\-no\\-such\\fR\n")
        self.run_tool("--generate", "man", "page.in", expect=70).says("--no-such")
        self.path("page.in").write_text("@NOTHING@\n")
        self.run_tool("--generate", "man", "page.in", expect=70).says("@NOTHING@")

    def test_every_option_is_in_the_manual_with_help(self):
        page = (SOURCE / "man/envconv.1").read_text().replace("\\-", "-")
        for verb in ("convert", "info", "layouts", "compare", "roundtrip", "analyze", "pattern"):
            out = self.run_tool(verb, "--help").out
            for option in re.findall(r"^  (?:-\w, )?(--[a-z-]+)", out, re.M):
                self.assertIn(option, page)

    def test_every_figure_is_in_the_manual(self):
        page = (SOURCE / "man/envconv-metrics.7").read_text().replace('" "', " ")
        self.run_tool("compare", PANORAMAS / "city.exr", PANORAMAS / "city.exr")
        for figure in self.out.splitlines()[2].split()[1:]:
            self.assertRegex(page, rf"\n\.BR? .*\b{figure}\b")

    def test_commands_of_the_readme_work(self):
        for folder in ("in", "out", "testdata/panoramas"):
            self.path(folder).mkdir(parents=True)
            shutil.copy(PANORAMAS / "venice.hdr", self.path(folder))
        shutil.copy(PANORAMAS / "venice.hdr", self.folder)
        text = (SOURCE / "README.md").read_text()
        commands = re.findall(r"^    (?:tools/run\.sh|envconv) ((?:convert|info|layouts|compare|roundtrip|analyze|pattern) .*)$", text, re.M)
        self.assertGreater(len(commands), 5)
        for command in commands:
            done = subprocess.run(["bash", "-c", f"'{BINARY}' {command}"], cwd=self.folder, capture_output=True, text=True)
            self.assertEqual((done.returncode, done.stderr), (0, ""), command)


class Completions(Case):
    def script(self, shell):
        path = self.path(f"envconv.{shell}")
        path.write_text(self.run_tool("completion", shell).out)
        return path

    def complete_in_bash(self, *words):
        quoted = " ".join(f"'{w}'" for w in words)
        program = (f"source {self.script('bash')}; COMP_WORDS=({quoted}); COMP_CWORD={len(words) - 1}; _envconv; "
                   'printf "%s\\n" "${COMPREPLY[@]}"')
        done = subprocess.run(["bash", "-c", program], cwd=self.folder, capture_output=True, text=True)
        self.assertEqual(done.stderr, "")
        return done.stdout.split()

    def test_bash(self):
        self.assertEqual(self.complete_in_bash("envconv", "con"), ["convert"])
        self.assertEqual(self.complete_in_bash("envconv", "convert", "--to", "octahedral-"), ["octahedral-equal-area"])
        self.assertEqual(self.complete_in_bash("envconv", "convert", "--to", "=", "octahedral-"),
                         ["octahedral-equal-area"])
        self.assertIn("--nonfinite", self.complete_in_bash("envconv", "convert", "x.exr", "--no"))
        self.assertEqual(self.complete_in_bash("envconv", "completion", "z"), ["zsh"])
        self.path("sky.exr").touch()
        self.assertEqual(self.complete_in_bash("envconv", "info", "sk"), ["sky.exr"])
        self.assertEqual(self.complete_in_bash("envconv", "convert", "-o", "sk"), ["sky.exr"])

    def test_zsh(self):
        script = self.script("zsh")
        subprocess.run(["zsh", "-n", script], check=True)
        done = subprocess.run(["zsh", "-fc", f"autoload -Uz compinit; compinit -D; source {script}; "
                               "print $_comps[envconv]"], capture_output=True, text=True, cwd=self.folder)
        self.assertEqual((done.stdout, done.stderr), ("_envconv\n", ""))

    def test_fish(self):
        script = self.script("fish")
        env = {"HOME": str(self.folder), "PATH": "/usr/bin:/bin"}
        for line, wanted in (("envconv con", "convert"), ("envconv convert --to octahedral-", "octahedral-equal-area"),
                             ("envconv completion z", "zsh")):
            done = subprocess.run(["fish", "-c", f"source {script}; complete -C'{line}'"], capture_output=True, text=True,
                                  cwd=self.folder, env=env)
            self.assertIn(wanted, [word.split("\t")[0] for word in done.stdout.splitlines()], done.stderr)

    def test_unknown_shell(self):
        self.run_tool("completion", "tcsh", expect=2).says("bash, zsh, fish")


if __name__ == "__main__":
    unittest.main()
