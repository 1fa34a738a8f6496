/** The car from above: body, wheels, sensors where they are, rows where they act; a click chooses a row. */

import { s } from "./dom.js";
import { times } from "./format.js";

const WIDTH = 264;
const HEIGHT = 250;
const LENGTH = 168; // of the wheelbase in the picture
const OVERHANG = 33;
const CORNERS = ["fl", "fr", "rl", "rr"];
/** Stands in where the study does not say: the proportions of a saloon [m]. */
const ORDINARY = { wheelbase: 2.7, track: { front: 1.5, rear: 1.5 } };

/**
 * Draw the car into `root` and keep it: `update` draws it anew with the state's study, version and row.
 * @param {HTMLElement} root
 * @param {Object} app
 * @returns {{update: () => Promise<void>}}
 */
export function createCar(root, app) {
  const svg = s("svg", {
    viewBox: `0 0 ${WIDTH} ${HEIGHT}`,
    class: "car",
    role: "group",
    "aria-label": "the car from above, front at the top",
  });
  const said = document.createElement("p");
  said.className = "car-says";
  root.replaceChildren(svg, said);
  let car = null;
  let of = null;
  let chosen = null;

  function say(text) {
    const { study } = app.state;
    said.textContent =
      text ||
      (study?.exists
        ? `Error ÷ floor over all runs used. ! fails in a run: above ${study.fails_above}.`
        : "Sensors and rows show once there are runs.");
  }

  async function update() {
    const { study } = app.state;
    const key = `${study?.vehicle}|${study?.rig}|${study?.exists}|${(study?.used ?? []).length}`;
    if (key !== of) {
      of = key;
      try {
        car = study?.exists ? await app.api.get("api/car") : null;
      } catch {
        car = null; // the picture then stays without sensors
      }
    }
    draw();
  }

  function draw() {
    const rows = new Map(app.rows().map((r) => [r.row, r]));
    const focused = document.activeElement?.getAttribute?.("data-testid");
    const at = layout(car);
    svg.replaceChildren(body(at), ...CORNERS.flatMap((c) => corner(c, at, rows)), chassis(at, rows), ...sensors(at));
    // Tab stops once, at the row chosen; arrows choose another, and the keyboard goes with it
    const stop = svg.querySelector("[aria-pressed=true]") ?? svg.querySelector("[role=button]");
    stop?.setAttribute("tabindex", "0");
    const there = focused && svg.querySelector(`[data-testid="${focused}"]`);
    if (there) (app.state.row === chosen ? there : stop).focus();
    chosen = app.state.row;
    say("");
  }

  function chip(row, x, y, w, tall, rows) {
    const { label, about } = app.state.study?.row_labels?.[row] ?? { label: "", about: row };
    const found = rows.get(row);
    const chosen = app.state.row === row;
    const lv = found?.level ?? -1;
    const text = `${about}: ${found ? `${times(found.ratio)} times its noise floor over all runs used, ${times(found.worst)} in its worst run ${found.worst_run}${found.fails ? ", fails" : ""}` : "no error known"}`;
    const choose = () => app.set({ row });
    const number = found ? times(found.ratio) : "–";
    const fails = found?.fails ? " !" : "";
    const group = s(
      "g",
      {
        class: `chip level${lv}${chosen ? " chosen" : ""}${tall > 24 ? " upright" : ""}`,
        role: "button",
        tabindex: "-1",
        "data-testid": `car-${row}`,
        "aria-label": text,
        "aria-pressed": String(chosen),
        transform: `translate(${x} ${y})`,
        onclick: choose,
        onkeydown: (e) => {
          if (e.key !== "Enter" && e.key !== " ") return;
          choose();
          e.preventDefault();
        },
        onpointerenter: () => say(text),
        onfocus: () => say(text),
        onpointerleave: () => say(""),
        onblur: () => say(""),
      },
      s("rect", { width: w, height: tall, rx: 3 }),
    );
    if (tall > 24) {
      group.append(
        s("text", { x: w / 2, y: 11, class: "chip-label", "text-anchor": "middle", text: `${label}${fails}` }),
        s("text", { x: w / 2, y: tall - 5, class: "chip-number", "text-anchor": "middle", text: number }),
      );
    } else {
      group.append(
        s("text", { x: 4, y: tall - 6, class: "chip-label", text: label }),
        s("text", { x: w - 4, y: tall - 6, class: "chip-number", "text-anchor": "end", text: `${number}${fails}` }),
      );
    }
    return group;
  }

  function corner(c, at, rows) {
    const { x, y } = at.corners[c];
    // rows of whole corners are there only where a rig has no wheel loads
    const own = ["suspension", "tyre", "spin", "corner"].map((kind) => `${kind}.${c}`).filter((r) => rows.has(r) || !r.startsWith("corner"));
    const worst = own
      .map((r) => rows.get(r))
      .filter(Boolean)
      .reduce((a, b) => (!a || b.ratio > a.ratio ? b : a), null);
    const left = c[1] === "l";
    const w = 77;
    const cx = left ? 0 : WIDTH - w;
    const out = [
      s("line", { class: "arm", x1: x, y1: y, x2: left ? at.body.x : at.body.x + at.body.w, y2: y }),
      s("rect", { class: `wheel level${worst?.level ?? -1}`, x: x - 7, y: y - 22, width: 14, height: 44, rx: 4 }),
    ];
    const first = Math.min(y - 33, HEIGHT - 1 - 23 * own.length);
    own.forEach((row, k) => {
      out.push(chip(row, cx, first + 23 * k, w, 21, rows));
    });
    return out;
  }

  function chassis(at, rows) {
    const w = (at.body.w - 16) / 2; // the gap leaves room for sensors on the middle plane, where most inertial units are
    const high = 30;
    // a band is left free where the inertial unit is, so that its mark hides no number
    const unit = (car?.sensors ?? []).find(
      (q) => q.channel.startsWith("imu") && q.placed !== false && Number.isFinite(q.x),
    );
    const mark = unit ? at.place(unit.x, unit.y)[1] : null;
    const tops = [];
    for (let y = at.middle - 54; tops.length < 3; y += high + 2) {
      if (mark !== null && y < mark + 8 && y + high > mark - 8) y = mark + 8;
      tops.push(y);
    }
    const parts = ["fx", "mx", "fy", "my", "fz", "mz"];
    return s(
      "g",
      null,
      parts.map((key, k) =>
        chip(`chassis.${key}`, at.body.x + 2 + (k % 2) * (w + 12), tops[Math.floor(k / 2)], w, high, rows),
      ),
    );
  }

  function sensors(at) {
    const places = new Map();
    for (const sensor of car?.sensors ?? []) {
      if (sensor.placed === false || !Number.isFinite(sensor.x) || !Number.isFinite(sensor.y)) continue;
      const kind = sensor.channel.split(".")[0];
      const key = `${kind} ${sensor.x.toFixed(2)} ${sensor.y.toFixed(2)}`;
      if (!places.has(key)) places.set(key, { kind, x: sensor.x, y: sensor.y, says: [] });
      places.get(key).says.push(`${sensor.channel}${sensor.unit ? ` [${sensor.unit}]` : ""}`);
    }
    return [...places.values()].map(({ kind, x: forward, y: aside, says }) => {
      const [x, y] = at.place(forward, aside);
      const text = says.join(", ");
      const mark =
        kind === "imu"
          ? s("path", { d: `M${x} ${y - 5}l5 5-5 5-5-5z` })
          : kind === "laser"
            ? s("path", { d: `M${x - 4} ${y + 3.5}h8l-4-7.5z` })
            : kind === "camera"
              ? s("rect", { x: x - 3.5, y: y - 3.5, width: 7, height: 7 })
              : s("circle", { cx: x, cy: y, r: 3.5 });
      return s(
        "g",
        { class: `sensor ${kind}`, onpointerenter: () => say(text), onpointerleave: () => say("") },
        s("title", { text }),
        mark,
      );
    });
  }

  say("");
  draw();
  return { update };
}

/** Where things are in the picture; the car's x is forward and y to the left, the picture's front is at the top. */
function layout(car) {
  const { wheelbase, track } = car?.wheelbase ? car : ORDINARY;
  const scale = LENGTH / wheelbase;
  const middle = HEIGHT / 2;
  const given = car?.corners ?? {};
  const known = CORNERS.every((c) => Number.isFinite(given[c]?.x) && Number.isFinite(given[c]?.y));
  const from = known ? (given.fl.x + given.rl.x) / 2 : 0;
  const place = (x, y) => [WIDTH / 2 - y * scale, middle - (x - from) * scale];
  const corners = {};
  for (const c of CORNERS) {
    const half = (c[0] === "f" ? track.front : track.rear) / 2;
    const [x, y] = known
      ? place(given[c].x, given[c].y)
      : [WIDTH / 2 + (c[1] === "l" ? -1 : 1) * half * scale, middle + ((c[0] === "f" ? -1 : 1) * LENGTH) / 2];
    corners[c] = { x, y };
  }
  const inner = Math.max(corners.fl.x, corners.rl.x) + 9;
  return { corners, place, middle, body: { x: inner, w: WIDTH - 2 * inner } };
}

function body({ body: { x, w }, middle }) {
  const top = middle - LENGTH / 2 - OVERHANG;
  const end = middle + LENGTH / 2 + OVERHANG - 6;
  const l = x - 4;
  const r = x + w + 4;
  return s(
    "g",
    { class: "body", "aria-hidden": "true" },
    s("path", {
      d: `M${l + 14} ${top}Q${WIDTH / 2} ${top - 12} ${r - 14} ${top}Q${r} ${top + 6} ${r} ${top + 30}V${end - 22}Q${r} ${end} ${r - 14} ${end}H${l + 14}Q${l} ${end} ${l} ${end - 22}V${top + 30}Q${l} ${top + 6} ${l + 14} ${top}Z`,
    }),
    s("path", { class: "glass", d: `M${l + 8} ${middle - 58}Q${WIDTH / 2} ${middle - 74} ${r - 8} ${middle - 58}` }),
    s("path", { class: "glass", d: `M${l + 8} ${middle + 58}Q${WIDTH / 2} ${middle + 70} ${r - 8} ${middle + 58}` }),
    s("text", { x: WIDTH / 2, y: top + 14, "text-anchor": "middle", text: "front" }),
  );
}
