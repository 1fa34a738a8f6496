/** Live: the channels of a car that is recording now, and how well each arrives. */

import { h } from "../widgets/dom.js";
import { short } from "../widgets/format.js";

const LATE = 1.0; // a channel that has not been heard for so long is late [s]
const SLOW = 0.9; // part of its expected rate below which a channel is slow

/**
 * Show the view.
 * @param {HTMLElement} root
 * @param {Object} app
 * @returns {Promise<() => void>}
 */
export async function show(root, app) {
  const head = h("p", { class: "live-head", role: "status", text: "Asking for the car …" });
  const sum = h("p", { class: "live-sum" });
  const body = h("tbody");
  const text = h("input", { type: "text", id: "live-mark", maxlength: 120, placeholder: "slalom begins" });
  const marking = h(
    "form",
    { class: "bar", hidden: true },
    h("label", { for: "live-mark", text: "Marker" }),
    text,
    h("button", { type: "submit", text: "Mark now" }),
  );
  const marked = h("p", { class: "muted", role: "status" });
  marking.addEventListener("submit", async (event) => {
    event.preventDefault();
    try {
      const found = await app.api.post("api/live/mark", { text: text.value });
      marked.textContent = `Marked “${found.text}” at ${found.seconds.toFixed(1)} s of the recording.`;
      text.value = "";
    } catch (cause) {
      marked.textContent = cause.message;
    }
  });
  const wanted = h("input", { type: "checkbox", id: "live-ill" });
  root.append(
    h(
      "header",
      { class: "view-head" },
      h("h1", { text: "Live" }),
      h("p", {
        class: "muted",
        text: "What the car sends while it is recording: is every channel there, at its rate, without flags?",
      }),
    ),
    h("section", { class: "panel" }, head, sum, marking, marked),
    h(
      "section",
      { class: "panel flush" },
      h(
        "div",
        { class: "bar inset" },
        h("label", { class: "check" }, wanted, h("span", { text: "only channels with something wrong" })),
      ),
      h(
        "div",
        { class: "scroll live-scroll" },
        h(
          "table",
          null,
          h(
            "thead",
            null,
            h(
              "tr",
              null,
              h("th", { scope: "col", text: "Channel" }),
              h("th", { scope: "col", text: "Unit" }),
              h("th", { scope: "col", text: "State" }),
              ["Rate", "Expected", "Last heard", "Flagged", "Losses"].map((text) =>
                h("th", { scope: "col", class: "num", text }),
              ),
            ),
          ),
          body,
        ),
      ),
    ),
  );
  let last = null;

  function draw(live) {
    last = live;
    const channels = live.channels ?? [];
    const recording = live.recording ?? Boolean(live.run);
    marking.hidden = !(live.connected && recording);
    if (!live.connected) {
      head.textContent = live.endpoint ? `No car heard at ${live.endpoint} yet.` : "Not connected to a car.";
      sum.textContent = live.endpoint
        ? `${live.why ? `${live.why}. ` : ""}The page goes on listening.`
        : "Start the workbench with the car's address: lacet ui STUDY --connect tcp/192.168.1.10:7447";
    } else {
      const named = [live.manoeuvre, live.run].filter(Boolean).join(", ");
      head.textContent = recording
        ? `Recording: ${named}`
        : live.run
          ? `The run is over: ${named}`
          : "Connected; the car is not recording.";
      const ill = channels.filter((c) => verdict(c, recording).kind !== "good").length;
      sum.textContent = `${live.endpoint ?? ""}: ${channels.length} channels, ${ill ? `${ill} with something wrong` : "all as they should be"}.${lost(live.losses)}${live.down?.length ? ` Not heard at all: ${live.down.join(", ")}.` : ""}`;
    }
    const shown = channels.filter((c) => !wanted.checked || verdict(c, recording).kind !== "good");
    body.replaceChildren(
      ...shown.map((c) => {
        const v = verdict(c, recording);
        return h(
          "tr",
          { "data-testid": `live-${c.name}` },
          h("th", { scope: "row", class: "code", text: c.name }),
          h("td", { text: c.unit || "–" }),
          h("td", { class: v.kind }, h("span", { "aria-hidden": "true", text: `${v.mark} ` }), v.text),
          h("td", { class: "num", text: c.rate === null || c.rate === undefined ? "–" : `${short(c.rate, 3)} Hz` }),
          h("td", { class: "num", text: c.expected ? `${short(c.expected, 3)} Hz` : "–" }),
          h("td", {
            class: "num",
            text: c.age === null || c.age === undefined ? "never" : `${c.age.toFixed(1)} s ago`,
          }),
          h("td", {
            class: "num",
            text:
              typeof c.flagged === "number" && c.flagged > 0 && c.flagged < 1
                ? `${(100 * c.flagged).toFixed(1)} %`
                : String(c.flagged ?? 0),
          }),
          h("td", {
            class: "num",
            text:
              typeof c.losses === "object" && c.losses
                ? Object.entries(c.losses)
                    .map(([k, n]) => `${n} ${k}`)
                    .join(", ") || "0"
                : String(c.losses ?? 0),
          }),
        );
      }),
    );
    if (!shown.length)
      body.append(
        h(
          "tr",
          null,
          h("td", {
            colspan: 8,
            class: "empty",
            text: channels.length ? "No channel has anything wrong." : "No channel has been heard.",
          }),
        ),
      );
  }

  wanted.addEventListener("change", () => last && draw(last));
  const off = app.on((patch) => {
    if (patch.live) draw(patch.live);
  });
  try {
    draw(await app.api.get("api/live"));
  } catch (cause) {
    head.textContent = cause.message;
  }
  return off;
}

/** @param {Object|undefined} losses by bus and cause @returns {string} them in words */
function lost(losses) {
  const parts = Object.entries(losses ?? {}).flatMap(([bus, causes]) =>
    Object.entries(typeof causes === "object" && causes ? causes : { lost: causes })
      .filter(([, n]) => n > 0)
      .map(([cause, n]) => `${bus}: ${n} ${cause}`),
  );
  return parts.length ? ` Lost: ${parts.join("; ")}.` : "";
}

/** @param {Object} c a channel @param {boolean} recording whether it should be heard now @returns {{kind: string, mark: string, text: string}} its state, in a symbol and words too */
function verdict(c, recording) {
  if (c.age === null || c.age === undefined) return { kind: "bad", mark: "✕", text: "never heard" };
  if (recording && c.age > LATE + (c.expected ? 2 / c.expected : 0)) return { kind: "bad", mark: "✕", text: "silent" };
  if (c.expected && c.rate < SLOW * c.expected) return { kind: "warn", mark: "!", text: "too slow" };
  if (c.flagged) return { kind: "warn", mark: "!", text: "flagged" };
  if (typeof c.losses === "object" ? Object.keys(c.losses ?? {}).length : c.losses)
    return { kind: "warn", mark: "!", text: "losses" };
  return recording ? { kind: "good", mark: "✓", text: "good" } : { kind: "good", mark: "✓", text: "was good" };
}
