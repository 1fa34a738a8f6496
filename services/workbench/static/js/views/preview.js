/** What a candidate would do where it does most: the residual of its own row in that row's worst run, now and with it. */

import { debounce, h } from "../widgets/dom.js";

const HEIGHT = 150;
const REST = 300; // before a model is fitted for a line that is only passed on the way to another [ms]

/**
 * @param {Object} app
 * @param {{effects: Map<string, Object>}} about
 * @param {{of: Function}} previews
 */
export function createPreview(app, about, previews) {
  const title = h("h2", { text: "What Add would do" });
  const figure = h("div", { class: "preview-chart", "data-testid": "preview" });
  const numbers = h("p", { class: "preview-numbers", role: "status", "data-testid": "preview-says" });
  const why = h("div", { class: "preview-why" });
  const element = h(
    "section",
    { class: "panel preview", "aria-label": "What adding the chosen effect would do" },
    title,
    numbers,
    figure,
    why,
  );
  let chart = null;
  let candidate = null;
  let turn = 0;
  let wanted = new AbortController(); // ends when another candidate is chosen
  let library = null;

  const load = debounce(() => void read(), REST);

  function words() {
    if (!candidate) {
      title.textContent = "What Add would do";
      numbers.textContent = "Choose an effect of the ranking: the model is fitted with it, and its own row shown here.";
      why.replaceChildren();
      return;
    }
    const record = about.effects.get(candidate.effect);
    title.textContent = `With ${candidate.label}`;
    why.replaceChildren(
      h("p", { text: candidate.why }),
      record
        ? h("p", { class: "muted preview-about", text: `${record.about}. ${record.shown_by ? `Shown by: ${record.shown_by}.` : ""}` })
        : "",
    );
  }

  /** What was asked for is not wanted any more, once what is asked for next has begun: its fit is cancelled. */
  function renew(begin = () => null) {
    const before = wanted;
    wanted = new AbortController();
    const found = begin();
    before.abort();
    return found;
  }

  async function read() {
    const mine = ++turn;
    if (!candidate) return;
    if (candidate.answer === "not testable") {
      blank("These runs do not show it: there is nothing to draw.");
      return;
    }
    numbers.textContent = "Fitting the model with it …";
    try {
      const say = (text) => {
        if (mine === turn) numbers.textContent = text;
      };
      const found = await renew(() => previews.of(app.state.version, candidate.effect, say, wanted.signal));
      if (mine === turn) await draw(found, mine);
    } catch (cause) {
      if (mine === turn) blank(cause.constructor?.name === "Cancelled" ? "Cancelled: choose it again to go on." : cause.message);
    }
  }

  function blank(text) {
    numbers.textContent = text;
    chart?.destroy?.();
    chart = null;
    figure.replaceChildren();
  }

  async function draw({ meta, arrays }, mine) {
    library ??= await import("../charts/time_chart.js");
    if (mine !== turn) return;
    numbers.textContent = meta.says;
    figure.dataset.row = meta.row;
    figure.dataset.run = meta.run;
    const colours = app.palette();
    const series = [
      { name: "residual now", values: arrays.now, colour: colours.residual, width: 1 },
      { name: "with it", values: arrays.after, colour: colours.modelled, width: 1.3 },
    ];
    const { unit } = meta;
    const picture = { t: arrays.t, series, unit, title: meta.row };
    if (chart) chart.update(picture);
    else chart = library.timeChart(figure, { ...picture, height: HEIGHT });
  }

  words();
  return {
    element,
    /** @param {Object|null} c a candidate @param {boolean} fit whether the model is fitted with it */
    show(c, fit) {
      if (c?.effect !== candidate?.effect) {
        blank("");
        renew();
      }
      candidate = c;
      turn += 1;
      load.cancel();
      words();
      if (c && fit) load();
      else if (c) numbers.textContent = "Choose it in the ranking: the model is then fitted with it, and its own row shown.";
    },
    theme() {
      chart?.destroy?.();
      chart = null;
      figure.replaceChildren();
      load();
    },
    destroy() {
      turn += 1;
      load.cancel();
      renew();
      chart?.destroy?.();
    },
  };
}
