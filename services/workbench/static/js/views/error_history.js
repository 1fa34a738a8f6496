/** The error falls: the waterfall by version, the parameters and how they changed, and what can be taken away. */

import { h } from "../widgets/dom.js";
import { number, times } from "../widgets/format.js";
import { term } from "../widgets/terms.js";
import { createWaterfall, legend } from "../charts/waterfall.js";
import { arrow, differs } from "./car_parameters.js";

/**
 * Show the view.
 * @param {HTMLElement} root
 * @param {Object} app
 * @returns {Promise<() => void>}
 */
export async function show(root, app) {
  let busy = false;
  let closed = false;
  let found = null;
  const waterfall = createWaterfall((version) => void go(version));
  const versions = h("tbody");
  const body = h("tbody");
  const heads = h("tr");
  const filter = h("input", {
    type: "search",
    placeholder: "filter",
    title: "by name, effect or unit",
    "aria-label": "filter the parameters",
    class: "filter",
    "data-testid": "parameter-filter",
  });
  const sheet = h("input", { type: "checkbox", id: "with-sheet", checked: true });
  const changes = h("input", { type: "checkbox", id: "with-changes", checked: true });
  const said = h("p", { class: "muted sub", role: "status" });
  const reportButton = (testid, text, files) => {
    const button = h("button", { type: "button", "data-testid": testid, text, onclick: () => void takeReport(button, files) });
    return button;
  };
  const take = (what, text, id) =>
    h("a", { class: "button", href: `api/export/${what}`, download: what, "data-testid": id, text });
  const tools = [
    reportButton("export-report", "Report (HTML)", ["report.html"]),
    reportButton("export-markdown", "Report (Markdown)", ["report.md", "report.png"]),
    take("parameters.csv", "Parameters (CSV)", "export-csv"),
    take("versions.csv", "Versions (CSV)", "export-versions"),
    take("study.json", "Study (JSON)", "export-json"),
  ];
  const left = h("details", { class: "left-open" });
  root.append(
    h(
      "div",
      { class: "falls-head" },
      h("h1", { text: "The error falls" }),
      h("div", { class: "bar exports" }, h("span", { class: "muted", text: "Export:" }), tools),
    ),
    h(
      "div",
      { class: "falls-top" },
      h(
        "section",
        { class: "panel" },
        h(
          "h2",
          { title: "a version chosen becomes the present one" },
          "Error ÷ noise floor by version",
          term(app, "version"),
          h("span", { class: "muted legend" }, legend()),
        ),
        waterfall.element,
      ),
      h(
        "section",
        { class: "panel flush versions" },
        h(
          "div",
          { class: "scroll versions-scroll", tabindex: "0", role: "region", "aria-label": "versions" },
          h(
            "table",
            null,
            h(
              "thead",
              null,
              h(
                "tr",
                null,
                ["Version", "What was done"].map((t) => h("th", { scope: "col", text: t })),
                ["used", "held out"].map((t) => h("th", { scope: "col", class: "num", text: t })),
                h("th", { scope: "col" }, h("span", { class: "sr", text: "go there" })),
              ),
            ),
            versions,
          ),
        ),
      ),
    ),
    h(
      "section",
      { class: "panel flush" },
      h(
        "div",
        { class: "bar inset" },
        h("h2", null, "Parameters ", term(app, "interval")),
        filter,
        h("label", { class: "check" }, changes, h("span", { text: "earlier versions" })),
        h("label", { class: "check" }, sheet, h("span", { text: "intervals with the sensor sheet" })),
        h("span", { class: "end muted count" }),
      ),
      h(
        "div",
        { class: "scroll parameters-scroll", tabindex: "0", role: "region", "aria-label": "parameters" },
        h("table", { class: "parameters", "data-testid": "parameters" }, h("thead", null, heads), body),
      ),
      left,
      said,
    ),
  );

  async function go(version) {
    if (busy || version === app.state.study?.current) return;
    busy = true;
    draw();
    try {
      await app.api.run("goto", { version });
      await app.refresh();
    } catch (cause) {
      app.complain(cause);
    }
    busy = false;
    if (!closed) draw();
  }

  async function takeReport(button, files) {
    const text = button.textContent;
    button.disabled = true;
    button.textContent = "Writing the report …";
    try {
      await app.api.run("report", {});
      for (const name of files) {
        const link = h("a", { href: `api/export/${name}`, download: name });
        document.body.append(link);
        link.click();
        link.remove();
      }
      app.toast(`The report is written: ${files.join(" and ")}, also in the study's folder.`, "good");
    } catch (cause) {
      app.complain(cause);
    }
    button.textContent = text;
    button.disabled = false;
  }

  function draw() {
    const { study } = app.state;
    const list = study?.versions ?? [];
    waterfall.update(list, study?.current ?? null, busy);
    versions.replaceChildren(
      ...list.map((v) =>
        h(
          "tr",
          { class: v.version === study.current ? "present" : "", "data-testid": `version-${v.version}` },
          h("th", { scope: "row", text: String(v.version) }),
          h(
            "td",
            null,
            v.note,
            v.parent ? h("span", { class: "muted", text: ` (from ${v.parent})` }) : "",
            v.runs_differ
              ? h("div", {
                  class: "sub warn",
                  text: "! on other runs: its errors do not compare with the present ones",
                })
              : null,
          ),
          h("td", { class: "num", title: study.meanings.pooled, text: times(v.used_error) }),
          h("td", { class: "num", text: times(v.held_error) }),
          h(
            "td",
            { class: "act" },
            v.version === study.current
              ? h("span", { class: "present-mark", text: "present" })
              : h("button", {
                  type: "button",
                  class: "small",
                  disabled: busy,
                  text: "Go to",
                  "aria-label": `Go to version ${v.version}`,
                  "data-testid": `goto-${v.version}`,
                  onclick: () => void go(v.version),
                }),
          ),
        ),
      ),
    );
    if (!list.length)
      versions.append(
        h("tr", null, h("td", { colspan: 5, class: "empty", text: "No version yet: choose runs first." })),
      );
    for (const tool of tools) {
      if (tool.tagName === "BUTTON") tool.disabled = !study?.exists;
      else if (study?.exists) tool.removeAttribute("aria-disabled");
      else tool.setAttribute("aria-disabled", "true");
    }
  }

  async function read() {
    const { study, version } = app.state;
    if (!study?.exists || !version) {
      found = null;
      table();
      return;
    }
    try {
      const answer = await app.api.get(`api/parameters?version=${version}`);
      if (closed || version !== app.state.version) return;
      found = answer;
      said.textContent = "";
    } catch (cause) {
      said.textContent = cause.message;
    }
    table();
  }

  function older() {
    const numbers = new Set((found?.parameters ?? []).flatMap((p) => (p.before ?? []).map((b) => b.version)));
    return [...numbers].sort((a, b) => a - b).slice(-3);
  }

  const half = (p) => (sheet.checked ? p.half95_sheet : null) ?? p.half95;

  function table() {
    const back = changes.checked ? older() : [];
    const column = (text, title) => h("th", { scope: "col", class: "num", text, title });
    heads.replaceChildren(
      h("th", { scope: "col", text: "Parameter" }),
      h("th", { scope: "col", class: "of-effect", text: "Effect" }),
      column(`Value${found ? `, version ${found.version}` : ""}`),
      sheet.checked
        ? column("± with sheet", "half of the 95 % interval: noise, zeros, and the sensor sheet's gains and latencies")
        : column("± 95 %", "half of the 95 % interval: noise and zeros"),
      h("th", { scope: "col", text: "Unit" }),
      column("A priori", "what the vehicle file says"),
      ...back.map((n) => h("th", { scope: "col", class: "num" }, `version ${n} `, h("span", { class: "moved", text: "change" }))),
    );
    const words = filter.value.trim().toLowerCase().split(/\s+/).filter(Boolean);
    const fits = (p) =>
      words.every((w) => `${p.label ?? ""} ${p.name} ${p.effect} ${p.unit} ${p.group ?? ""}`.toLowerCase().includes(w));
    const list = (found?.parameters ?? []).filter(fits);
    root.querySelector(".panel .count").textContent = found ? `${list.length} of ${found.parameters.length}` : "";
    body.replaceChildren(
      ...list.map((p) =>
        h(
          "tr",
          { "data-testid": `parameter-${p.name}` },
          h(
            "th",
            { scope: "row", title: p.group && p.group !== p.name ? `stands for ${p.group}` : null },
            `${p.label} `,
            h("span", { class: "muted code", text: p.sum || p.name }),
          ),
          h("td", { class: "muted of-effect", text: p.effect }),
          h("td", { class: "num strong", text: number(p.value, half(p)) }),
          h("td", { class: "num", text: `± ${number(half(p), half(p))}` }),
          h("td", { text: p.unit || "–" }),
          h("td", {
            class: "num muted",
            title: p.apriori_source || null,
            text: p.apriori === null || p.apriori === undefined ? "–" : number(p.apriori),
          }),
          back.map((n) => change(p.before.find((b) => b.version === n))),
        ),
      ),
    );
    if (!list.length)
      body.append(
        h(
          "tr",
          null,
          h("td", {
            colspan: 9,
            class: "empty",
            text: found
              ? "No parameter fits this filter."
              : app.state.study?.exists
                ? "Reading the parameters …"
                : "Parameters show once there is a model.",
          }),
        ),
      );
    const open = (found?.not_identifiable ?? []).filter(fits);
    left.hidden = !open.length;
    left.replaceChildren(
      h("summary", { text: `${open.length} without a value: these runs do not determine them` }),
      h(
        "ul",
        null,
        open.map((p) => h("li", null, h("code", { text: p.name }), `: ${p.why}`)),
      ),
    );
  }

  /** An earlier value, and how it changed since where the server says that it did. */
  function change(before) {
    if (!before?.other) return h("td", { class: "num muted" }, "–", h("span", { class: "moved" }));
    return h("td", { class: "num", title: differs(before.differs, before.version) },
      number(before.other.value, half(before.other)),
      h("span", { class: "moved", text: before.differs ? arrow(before) : "" }));
  }

  filter.addEventListener("input", table);
  sheet.addEventListener("change", table);
  changes.addEventListener("change", table);
  const off = app.on((patch) => {
    if ("study" in patch) {
      draw();
      void read();
    }
  });
  draw();
  table();
  void read();
  return () => {
    closed = true;
    off();
  };
}
