#!/bin/sh
# Makes every capture and truth file of a folder anew: sh replay_logs/make.sh [FOLDER]   (default: this one)
# Needs the simulator (`make test` installs it: extra sim). Another command than .venv/bin/lacet: LACET='python -m services'
set -eu
here=$(cd "$(dirname "$0")" && pwd)
to=${1:-$here}
LACET=${LACET:-$here/../.venv/bin/lacet}
campaign() {
    set_name=$1
    shift
    $LACET simulate --rig peugeot-406 --set duration=16 \
        --manoeuvre sinus --manoeuvre liftoff --manoeuvre rough --manoeuvre spiral --manoeuvre braking \
        "$@" -o "$to/$set_name" --truth "$to/truth/$set_name.json" --force
    rm "$to/$set_name/peugeot-406.toml" # the captures carry it
}
campaign anti-roll-bars --seed 2 --hide anti_roll_bar.front=19780 --hide anti_roll_bar.rear=19185
campaign nothing-hidden --seed 1
