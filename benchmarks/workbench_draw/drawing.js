// Draws channels of a run in a layout and zooms them, as a view does and a hand; each time is from the action to the
// frame after the one in which the picture was drawn [ms].
async ({ charts, each, height, channels }) => {
  const { timeChart, pending } = await import("/js/charts/time_chart.js");
  const { link } = await import("/js/charts/linked_axes.js");
  const { readChannels } = await import("/js/net/run_channels.js");
  const root = document.createElement("div");
  root.style.cssText = "position:fixed;inset:0;overflow:auto;background:var(--panel);z-index:99";
  document.body.append(root);
  const MOVES = 6; // of the mouse in a drag, one a frame
  const frame = () => new Promise((done) => requestAnimationFrame(done));
  const plots = () => [...root.querySelectorAll(".chart-plot")];
  const sight = () => plots().filter((p) => {
    const box = p.getBoundingClientRect();
    return box.bottom > 0 && box.top < innerHeight;
  });
  let made = [];
  let actions = [];

  function show(found) {
    const lines = channels.flatMap((name) => {
      const { t, parts, rough } = found.get(name);
      return parts.map(([part, values]) => ({ t, rough, name: `${name} ${part}`, values }));
    });
    const chart = (k) => {
      const own = lines.slice(k * each, (k + 1) * each);
      const series = own.map(({ name, values }, j) => ({ name, values, colour: `--effect-${j % 8}` }));
      return { t: own[0].t, rough: own[0].rough, series, title: `plot ${k + 1}`, sync: "benchmark", height };
    };
    if (made.length) made.forEach((one, k) => one.update(chart(k)));
    else made = Array.from({ length: charts }, (_, k) => timeChart(root, chart(k)));
  }

  async function timed(act) {
    const start = performance.now();
    act();
    await frame(); // what is in sight is drawn in this frame
    await frame();
    const drawn = performance.now() - start;
    while (pending()) await frame();
    return drawn;
  }

  let hand = null; // the plot that the mouse is over, and its box
  function point() {
    const target = sight()[0].querySelector(".u-over");
    hand = { target, box: target.getBoundingClientRect() };
  }
  function mouse(type, part, more = {}) {
    const { target, box } = hand;
    target.dispatchEvent(new MouseEvent(type, { bubbles: true, cancelable: true, view: window, button: 0, movementX: 1,
      clientX: box.left + part * box.width, clientY: box.top + 0.5 * box.height, ...more }));
  }
  function wheel(deltaY, shiftKey) {
    const { target, box } = hand;
    target.dispatchEvent(new WheelEvent("wheel", { bubbles: true, cancelable: true, deltaY, shiftKey,
      clientX: box.left + 0.4 * box.width, clientY: box.top + 0.5 * box.height }));
  }
  /** Draws a frame over a part of the window, in 100 ms as a quick hand; the time begins when the button is let go. */
  async function drag(from, part, seconds) {
    mouse("mousemove", from);
    mouse("mousedown", from);
    for (let k = 1; k <= MOVES; k += 1) {
      mouse("mousemove", from + (k / MOVES) * part);
      await frame();
    }
    const drawn = await timed(() => mouse("mouseup", from + part));
    const [a, b] = link("benchmark").shown;
    if (Math.abs(b - a - seconds) > 0.1 * seconds) throw new Error(`${b - a} s are shown, not ${seconds} s`);
    return drawn;
  }

  window.bench = {
    /** A fixed piece of work, whose time shows what else the machine does. */
    reference() {
      const start = performance.now();
      const values = new Float64Array(4096);
      for (let k = 0; k < 20_000_000; k += 1) values[k & 4095] = values[(k * 7) & 4095] * 0.5 + k;
      return values[0] > -1 ? performance.now() - start : 0;
    },
    async first(run) {
      const start = performance.now();
      const out = {};
      let sharp;
      const reading = readChannels(run, channels, (found) => {
        if (made.length) sharp = performance.now() - start;
        else out.answer = performance.now() - start;
        show(found);
      });
      while (!made.length) await frame();
      do await frame(); while (sight().some((p) => !p.querySelector("canvas")));
      await frame();
      out["first draw of those in sight"] = performance.now() - start;
      await reading;
      out["samples"] = sharp;
      do await frame(); while (pending());
      await frame();
      out["all samples drawn"] = performance.now() - start;
      return { times: out, seen: sight().length };
    },
    /** Zooms as with a mouse, from the whole run to a fifth of a second and back: one of the actions after the other. */
    acts(seconds) {
      const k = Math.random() * 0.3;
      const reset = () => timed(() => mouse("dblclick", 0.5));
      actions = [
        ["zoom: whole run to 60 s", () => drag(0.3 + k, 60 / seconds, 60)],
        ["pan by 6 s of 60 s", () => timed(() => wheel(1, true))],
        ["zoom: wheel, 60 s to 48 s", () => timed(() => wheel(-1, false))],
        ["zoom: 48 s to 5 s", () => drag(0.3 + k, 5 / 48, 5)],
        ["pan by 0.5 s of 5 s", () => timed(() => wheel(1, true))],
        ["zoom: 5 s to 0.2 s", () => drag(0.3 + k, 0.04, 0.2)],
        ["reset from 0.2 s", reset],
        ["zoom: whole run to 240 s", () => drag(0.2 + k, 240 / seconds, 240)],
        ["reset from 240 s", reset],
      ];
      return actions.map(([name]) => name);
    },
    async act(number) {
      point();
      await frame();
      return actions[number][1]();
    },
    /** Scrolls to the last plot; until it is drawn. */
    async scroll() {
      const start = performance.now();
      root.scrollTop = root.scrollHeight;
      do await frame(); while (sight().some((p) => !p.querySelector("canvas")));
      await frame();
      return performance.now() - start;
    },
    end() {
      for (const chart of made) chart.destroy();
      made = [];
      root.remove();
    },
  };
  await frame();
  await frame();
}
