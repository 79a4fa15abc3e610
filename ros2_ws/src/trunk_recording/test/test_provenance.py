import subprocess

from trunk_recording import provenance


def test_it_names_versions_machine_and_time():
    found = provenance.gather(scenario="fig6", rmw="rmw_x")
    assert found["scenario"] == "fig6"
    assert found["rmw"] == "rmw_x"
    assert found["format"] == provenance.FORMAT == "2"
    for name in (
        "numpy",
        "mcap",
        "rosbags",
        "trunk_msgs_util",
        "trunk_sim",
        "python",
        "started_utc",
    ):
        assert any(c.isdigit() for c in found[name]), name
    assert all(type(value) is str and value for value in found.values())


def test_it_does_not_fail_where_nothing_can_be_found(monkeypatch):
    def missing(*_, **__):
        raise FileNotFoundError("git")

    monkeypatch.setattr(subprocess, "Popen", missing)
    monkeypatch.setattr(provenance, "PACKAGES", ("no_such_package",))
    monkeypatch.delenv("ROS_DISTRO", raising=False)
    monkeypatch.delenv("TRUNK_COMMIT", raising=False)
    found = provenance.gather()
    assert found["commit"] == found["no_such_package"] == found["ros_distro"] == provenance.NONE


def test_the_commit_is_that_of_the_checkout_marked_if_it_was_changed(monkeypatch, tmp_path):
    def git(*arguments: str) -> str:
        identity = ["-c", "user.name=n", "-c", "user.email=e@example.org"]
        command = ["git", "-C", str(tmp_path), *identity, *arguments]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    source = tmp_path / "provenance.py"
    source.write_text("1\n")
    monkeypatch.setattr(provenance, "__file__", str(source))
    monkeypatch.delenv("TRUNK_COMMIT", raising=False)
    git("init")
    assert provenance.gather()["commit"] == provenance.NONE  # lies in a checkout, but not tracked
    monkeypatch.setenv("TRUNK_COMMIT", "of the image")
    assert provenance.gather()["commit"] == "of the image"
    git("add", ".")
    git("commit", "-m", "one")
    head = git("rev-parse", "HEAD")
    assert provenance.gather()["commit"] == head
    source.write_text("2\n")
    assert provenance.gather()["commit"] == f"{head}+dirty"


def test_a_git_that_hangs_holds_nothing_up(monkeypatch, tmp_path, capsys):
    git = tmp_path / "git"
    git.write_text("#!/bin/sh\nexec tail -f /dev/null\n")
    git.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    monkeypatch.setattr(provenance, "_PATIENCE_S", 0.1)
    assert provenance.gather()["commit"] == provenance.UNKNOWN
    assert "git does not answer within 0.1 s: the commit is unknown" in capsys.readouterr().err
