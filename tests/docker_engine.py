"""A Docker engine, or where none answers a clean Debian that follows a Dockerfile's steps."""

import json
import os
import re
import shutil
import signal
import subprocess
from pathlib import Path

from .finished import finished

ROOT = Path(__file__).parents[1]
DOCKER = ROOT / "docker"


def stages(text):
    """Return a Dockerfile's stages: name -> [(instruction, arguments)], the first one being FROM."""
    text = re.sub(r"^\s*#.*\n", "", text, flags=re.MULTILINE)
    found = {}
    for line in re.sub(r"\\\n\s*", "", text).splitlines():
        if line.strip():
            instruction, _, arguments = line.strip().partition(" ")
            if instruction == "FROM":
                steps = found.setdefault(arguments.split(" AS ")[1], [])
            steps.append((instruction, arguments.strip()))
    return found


STAGES = stages((DOCKER / "Dockerfile").read_text(encoding="utf-8"))
TARGETS = ("slim", "cluster", "ros")


def steps_of(stage):
    """Return a stage's steps after those of the stage that it starts from."""
    parent = STAGES[stage][0][1].split()[0]
    return [*(steps_of(parent) if parent in STAGES else ()), *STAGES[stage]]


def last(stage, instruction):
    return [arguments for name, arguments in steps_of(stage) if name == instruction][-1]


class CleanRoot:
    """A Debian in a folder, in which a Dockerfile's steps are done with chroot."""

    def __init__(self, folder, suite):
        self.folder = folder
        self.user, self.workdir, self.set = "root", "/", {}
        self.recordings = folder / "recordings"
        sources = (
            finished(
                ["apt-get", "indextargets", "--format", "$(REPO_URI)", f"Codename: {suite}"],
                check=True,
            ).stdout.split()
        )  # the mirror of this machine; debootstrap's own where it has no such Debian
        subprocess.run(
            ["debootstrap", "--variant=minbase", suite, folder, *sources[:1]], check=True
        )
        folder.chmod(0o755)  # it is the root folder of other users too
        # What an engine gives to a build: name service, proxies, and here the host's certificates.
        for name in ("resolv.conf", "hosts"):
            shutil.copy(f"/etc/{name}", folder / "etc" / name)
        extra = folder / "usr/local/share/ca-certificates"
        extra.mkdir(parents=True, exist_ok=True)
        shutil.copy("/etc/ssl/certs/ca-certificates.crt", extra / "host.crt")
        self._mounts = [folder / "proc", folder / "dev"]
        subprocess.run(["mount", "-t", "proc", "proc", self._mounts[0]], check=True)
        subprocess.run(["mount", "--bind", "/dev", self._mounts[1]], check=True)

    def close(self):
        for mount in self._mounts:
            subprocess.run(["umount", "--lazy", mount], check=True)

    def argv(self, *command, user=""):
        passed = [
            f"{k}={v}"
            for k, v in os.environ.items()
            if k.lower().endswith("_proxy") or k in ("PIP_CERT", "PIP_INDEX_URL")
        ]
        path = "PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
        own = [f"{name}={value}" for name, value in {"HOME": "/root", **self.set}.items()]
        inside = ["/usr/bin/env", "-i", f"--chdir={self.workdir}", path, *own, *passed]
        user = user or f"{self.user}:{self.user}"
        return ["chroot", f"--userspec={user}", self.folder, *inside, *command]

    def copy(self, arguments):
        *options, source, target = arguments.split()
        if options:  # of another stage, which was followed in this root too
            if source != target:
                command = self.argv("cp", "-a", f"{source}/.", target, user="root:root")
                subprocess.run(command, check=True)
            return
        listed = ["git", "-C", ROOT, "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
        for name in subprocess.check_output(listed, text=True).rstrip("\0").split("\0"):
            place = self.folder / self.workdir.lstrip("/") / name
            place.parent.mkdir(parents=True, exist_ok=True)
            if (ROOT / name).is_file():
                shutil.copy2(ROOT / name, place)

    def follow(self, steps):
        for instruction, arguments in steps:
            if instruction == "RUN":
                self.user = "root"
                subprocess.run(self.argv("/bin/sh", "-c", arguments), check=True)
            elif instruction == "COPY":
                self.copy(arguments)
            elif instruction == "USER":
                self.user = arguments
            elif instruction == "WORKDIR":
                self.workdir = arguments
            elif instruction == "ENV" and "$" not in arguments:
                name, _, self.set[name] = arguments.partition("=")

    def run(self, *command, user=""):
        inside = self.argv(*json.loads(last("slim", "ENTRYPOINT")), *command, user=user)
        return finished(inside)

    def start(self, *command):
        return subprocess.Popen(self.argv(*json.loads(last("slim", "ENTRYPOINT")), *command))

    def stop(self, process):
        process.send_signal(getattr(signal, last("slim", "STOPSIGNAL")))
        return process.wait(9.0)  # docker stop kills after 10 s


class Engine:
    """Docker, and the image `trunk:slim` as this page's first command builds it."""

    NAME = f"trunk-test-{os.getpid()}"
    # As little as an image may need.
    LEAST = ("--read-only", "--tmpfs", "/tmp", "--cap-drop", "ALL", "--network", "none")

    def __init__(self, folder):
        self.recordings = folder
        folder.chmod(0o1777)
        head = ["git", "-C", ROOT, "rev-parse", "HEAD"]
        self.commit = subprocess.check_output(head, text=True).strip()
        subprocess.run(["bash", DOCKER / "build.sh", "slim"], check=True)

    @staticmethod
    def why_not():
        base = last("base", "FROM").split()[0]
        if shutil.which("docker") is None or docker("version").returncode:
            return "no Docker engine answers here"
        if docker("image", "inspect", base).returncode and docker("pull", base).returncode:
            return f"the engine neither has nor finds {base}"
        return None

    def argv(self, *command, options=()):
        mounted = ("-v", f"{self.recordings}:/recordings")
        return [
            "docker",
            "run",
            "--rm",
            "--name",
            self.NAME,
            *mounted,
            *options,
            "trunk:slim",
            *command,
        ]

    def run(self, *command, user=""):
        options = (*self.LEAST, *(("--user", user) if user else ()))
        inside = self.argv(*command, options=options)
        return finished(inside)

    def start(self, *command, options=()):
        return subprocess.Popen(
            self.argv(*command, options=options), stdout=subprocess.PIPE, text=True
        )

    def stop(self, process):
        assert not docker("stop", "--time", "60", self.NAME).returncode
        return process.wait()

    def close(self):
        docker("rm", "--force", self.NAME)


def docker(*words):
    return finished(["docker", *words])
