#!/usr/bin/env bash
# Regenerate the pictures of the pages, in docs/images, from fresh runs: scripts/pictures.sh
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/bootstrap.sh >/dev/null
# shellcheck source=scripts/env.sh
source scripts/env.sh
browser=$(bash scripts/browser.sh) || { echo 'pictures: a Chromium is needed, see above' >&2; exit 1; }

images=$PWD/docs/images
mkdir -p "$images"
runs=$(mktemp -d)
trap 'rm -rf "$runs"' EXIT

run() { # NAME SCENARIO CONTROLLER [options]
    trunk simulate "$2" --controller "$3" "${@:4}" -o "$runs/$1.mcap"
}
run pid-as-printed fig6 pid --params pid_as_printed
run pid-zn fig6 pid
run fuzzy fig6 fuzzy_pid
run fig8-pid fig8 pid
run fig8-fuzzy-pid fig8 fuzzy_pid
run demo demo fuzzy_pid
for fig in 7 9; do
    run "fig$fig-pid" "fig$fig" pid
    run "fig$fig-fuzzy-pid" "fig$fig" fuzzy_pid
done
run cart cart_pole state_feedback
trunk export "$runs/cart.mcap" --from 4.5 --to 8 -o "$images/cart_pole.gif" --force
trunk branch "$runs/demo.mcap" --at 3 --push 60Nm:0.1s -o "$runs/pushed.mcap"
trunk branch "$runs/demo.mcap" --at 3 --controller pid -o "$runs/pid.mcap"

trunk plot --force "$runs"/{pid-as-printed,pid-zn,fuzzy}.mcap --fig 6 -o "$images/fig6.png"
for fig in 7 8 9; do
    trunk plot --force "$runs/fig$fig-pid.mcap" "$runs/fig$fig-fuzzy-pid.mcap" --fig "$fig" -o "$images/fig$fig.png"
done
trunk plot --force "$runs"/{fig8-pid,fig8-fuzzy-pid}.mcap -o "$images/plot.png"
trunk plot --force "$runs"/{demo,pushed,pid}.mcap -o "$images/branches.png"
trunk rules read examples/rules/mamdani_5x5.fis --input e=error --input e_dot="error rate" --output-variable u=torque \
    -o "$runs/rules.yaml" --picture "$images/rules.png" --force
trunk report "$runs"/{fig8-pid,fig8-fuzzy-pid}.mcap -o "$runs/report.html"
trunk report "$runs/demo.mcap" -o "$runs/surface.html"

for study in actuator network delay_gain; do
    trunk sweep "$study" -o "$runs/$study.parquet"
    trunk study map "$runs/$study.parquet" -o "$images/$study.png" --force
done

trunk sweep basin -o "$runs/basin.parquet"
trunk study map "$runs/basin.parquet" --metric iae --no-floquet -o "$images/basin.png" --force

python scripts/push_picture.py "$browser" "$images/push.gif" "$images/live.png"
python - "$browser" "$runs" "$images" <<'END'
import sys
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

browser, runs, images = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
with sync_playwright() as driver:
    chromium = driver.chromium.launch(executable_path=browser, args=["--no-sandbox", "--disable-gpu"])
    page = chromium.new_page(viewport={"width": 1200, "height": 1180})
    for name, at in (("report", 1.06), ("surface", 3.0)):
        page.goto((runs / f"{name}.html").as_uri())
        page.wait_for_selector("html[data-ready]")
        page.evaluate(f"() => view.seek({at})")
        page.wait_for_function("(at) => Number(document.getElementById('seek').value) === at", arg=at)
        target = images / f"{name}.png"
        if name == "report":
            page.screenshot(path=target)
        else:
            page.locator(".plane").last.screenshot(path=target)
    chromium.close()
for path in sorted(images.glob("*.png")):
    # 256 colours are enough for lines and flat areas, and a third of the size.
    Image.open(path).convert("RGB").quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)
    print(f"{path.relative_to(Path.cwd())}: {path.stat().st_size / 1000:.0f} kB")
END
