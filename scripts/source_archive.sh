#!/usr/bin/env bash
# Write the sources of the commit that is checked out: scripts/source_archive.sh FOLDER. Unpacked anywhere, without
# git, scripts/bootstrap.sh builds them. The commit is in the file: zcat FILE | git get-tar-commit-id
set -euo pipefail
die() { printf 'source_archive: %s\n' "$*" >&2; exit 1; }
(($# == 1)) && [[ $1 != -* ]] || die 'one argument is needed, the folder for the archive'
mkdir -p "$1" 2>/dev/null && [[ -w $1 ]] || die "$1: not a writable folder: give another"
target=$(realpath "$1")
cd -P "$(dirname "${BASH_SOURCE[0]}")/.."
[[ $(git rev-parse --show-toplevel 2>/dev/null) == "$PWD" ]] || die 'this is not a git checkout, so there is no commit to archive'
[[ -z $(git status --porcelain) ]] || die 'the checkout has uncommitted changes: commit or stash them first'
name=trunk-$(bash scripts/version.sh)
[[ ! -e $target/$name.tar.gz ]] || die "$1/$name.tar.gz: it exists: give another folder, or delete it"
trap 'rm -f "$target/.$name.part"' EXIT
git archive --format=tar --prefix="$name/" HEAD | gzip -9n >"$target/.$name.part"
mv "$target/.$name.part" "$target/$name.tar.gz"
printf 'source_archive: %s, commit %s\n' "$1/$name.tar.gz" "$(git rev-parse HEAD)"
