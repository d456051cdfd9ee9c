#!/bin/sh
# A simulated cell of a fleet: it measures, makes a model, runs a watch every EVERY seconds, and sends its documents.
# NUMBER: of the cell, its seed and the end of its serial number. A real cell PC needs `truepose fleet send` alone.
set -eu
number=${NUMBER:?}
to=${TO:-http://fleet:8036}
tokens=${TOKENS:-/tokens/tokens}
example=${EXAMPLE:-/example}
every=${EVERY:-600}
cd "${DATA:-/data}"
for file in cell campaign; do
    sed "s/^seed = .*/seed = $number/; s/^serial = .*/serial = \"120-50000$number\"/" "$example/$file.toml" >$file.toml
done

truepose fleet send . --to "$to" --token-file "$tokens" --cell "cell-$number" --simulated --every 10 &
sender=$!
job=$sender
trap 'kill $sender $job 2>/dev/null || true' EXIT
trap 'exit 0' INT TERM

run() {    # in the background, so that this shell receives signals at once
    "$@" &
    job=$!
    wait $job
}

if [ ! -f watch.toml ]; then
    record=campaign-$(date +%s)
    run truepose campaign run cell.toml campaign.toml --record "$record" --simulate
    run truepose campaign export "$record" "$record/data.csv"
    run truepose diagnose "$record/data.csv" --model model.json --json diagnosis.json
    run truepose watch plan model.json cell.toml --poses 8 --candidates 200 --out watch.toml
fi
while true; do
    record=watch-$(date +%s)
    code=0
    run truepose watch run model.json cell.toml watch.toml --record "$record" --simulate --json "$record.json" || code=$?
    # 3 and 6: something has changed; 5: paused for a person, e.g. because the instrument drifts: the next watch asks again
    case $code in 0 | 3 | 5 | 6) ;; *) exit $code ;; esac
    run sleep "$every"
done
