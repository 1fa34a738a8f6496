// Curves of a report: one canvas a row, all rows of a run with one window of time. Drag across to zoom, double click or 0
// for the whole run, arrows move, + and - zoom.
(() => {
  const LEFT = 64, RIGHT = 8, TOP = 4, BOTTOM = 20, TALL = 150;
  const ink = () => getComputedStyle(document.body).color;
  const text = (v, step) => v.toFixed(Math.max(0, Math.min(6, -Math.floor(Math.log10(step) + 1e-9)))).replace("-", "−");

  function unpack({ low, step, data }) {
    const bytes = atob(data);
    const out = new Float32Array(bytes.length / 2);
    for (let i = 0; i < out.length; i += 1) {
      const code = bytes.charCodeAt(2 * i) + 256 * bytes.charCodeAt(2 * i + 1);
      out[i] = code === 65535 ? NaN : low + code * step;
    }
    return out;
  }

  function steps(low, high, most) {
    const raw = (high - low) / most;
    const power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map((k) => k * power).find((s) => s >= raw);
    const out = [];
    for (let k = Math.ceil(low / step); k * step <= high; k += 1) out.push(k * step);
    return [out, step];
  }

  function run(box) {
    const rows = JSON.parse(box.querySelector("script").textContent);
    const whole = [Math.min(...rows.map((r) => r.t0)), Math.max(...rows.map((r) => r.t0 + r.dt * (r.n - 1)))];
    let shown = whole;
    const figures = rows.map((row) => figure(row));
    const all = () => figures.forEach((draw) => draw());
    const set = (a, b) => {
      const least = 10 * rows[0].dt;
      const span = Math.min(Math.max(b - a, least), whole[1] - whole[0]);
      const from = Math.min(Math.max(a, whole[0]), whole[1] - span);
      shown = [from, from + span];
      all();
    };

    function figure(row) {
      const element = document.createElement("figure");
      const head = element.appendChild(document.createElement("figcaption"));
      const canvas = element.appendChild(document.createElement("canvas"));
      element.dataset.row = row.row;
      head.textContent = row.title;
      if (row.bad) head.className = "fail";
      canvas.tabIndex = 0;
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", row.title);
      box.append(element);
      const series = row.series.map((s) => ({ ...s, values: unpack(s) }));
      let [begun, at] = [null, null];

      const place = (event) => {
        const r = canvas.getBoundingClientRect();
        return shown[0] + ((event.clientX - r.left - LEFT) / (r.width - LEFT - RIGHT)) * (shown[1] - shown[0]);
      };
      canvas.onpointerdown = (e) => { begun = place(e); canvas.setPointerCapture(e.pointerId); };
      canvas.onpointermove = (e) => { at = place(e); draw(); };
      canvas.onpointerleave = () => { at = null; draw(); };
      canvas.onpointerup = (e) => {
        const [a, b] = [begun, place(e)].sort((x, y) => x - y);
        begun = null;
        if (b - a > 0.01 * (shown[1] - shown[0])) set(a, b);
        else draw();
      };
      canvas.ondblclick = () => set(...whole);
      canvas.onkeydown = (e) => {
        const [a, b] = shown, span = b - a;
        if (e.key === "0") set(...whole);
        else if (e.key === "+") set(a + span / 4, b - span / 4);
        else if (e.key === "-") set(a - span / 2, b + span / 2);
        else if (e.key === "ArrowLeft") set(a - span / 5, b - span / 5);
        else if (e.key === "ArrowRight") set(a + span / 5, b + span / 5);
        else return;
        e.preventDefault();
      };

      function draw() {
        const wide = canvas.clientWidth;
        if (!wide) return; // folded
        const ratio = window.devicePixelRatio || 1;
        canvas.width = wide * ratio;
        canvas.height = TALL * ratio;
        const ctx = canvas.getContext("2d");
        ctx.scale(ratio, ratio);
        ctx.font = "11px system-ui, sans-serif";
        const [t0, t1] = shown;
        const first = Math.max(0, Math.floor((t0 - row.t0) / row.dt));
        const last = Math.min(row.n - 1, Math.ceil((t1 - row.t0) / row.dt));
        let [low, high] = [Infinity, -Infinity];
        for (const s of series) for (let i = first; i <= last; i += 1) {
          if (s.values[i] < low) low = s.values[i];
          if (s.values[i] > high) high = s.values[i];
        }
        if (!(low < high)) [low, high] = low === high ? [low - 1, high + 1] : [-1, 1];
        const room = 0.05 * (high - low);
        [low, high] = [low - room, high + room];
        const x = (t) => LEFT + ((t - t0) / (t1 - t0)) * (wide - LEFT - RIGHT);
        const y = (v) => TOP + ((high - v) / (high - low)) * (TALL - TOP - BOTTOM);
        ctx.fillStyle = ctx.strokeStyle = ink();
        ctx.lineWidth = 1;
        ctx.textAlign = "center";
        const [across, dx] = steps(t0, t1, Math.max(2, wide / 90));
        const [up, dy] = steps(low, high, 5);
        ctx.globalAlpha = 0.18;
        for (const t of across) ctx.fillRect(Math.round(x(t)), TOP, 1, TALL - TOP - BOTTOM);
        for (const v of up) ctx.fillRect(LEFT, Math.round(y(v)), wide - LEFT - RIGHT, 1);
        ctx.globalAlpha = 1;
        for (const t of across) ctx.fillText(`${text(t, dx)} s`, Math.min(x(t), wide - 16), TALL - 6);
        ctx.textAlign = "right";
        for (const v of up) ctx.fillText(text(v, dy), LEFT - 6, y(v) + 4);
        ctx.save();
        ctx.beginPath();
        ctx.rect(LEFT, TOP, wide - LEFT - RIGHT, TALL - TOP - BOTTOM);
        ctx.clip();
        for (const s of series) {
          ctx.strokeStyle = s.colour === "ink" ? ink() : s.colour;
          ctx.lineWidth = s.width;
          ctx.beginPath();
          let on = false;
          for (let i = first; i <= last; i += 1) {
            const v = s.values[i];
            if (v !== v) { on = false; continue; }
            if (on) ctx.lineTo(x(row.t0 + i * row.dt), y(v));
            else ctx.moveTo(x(row.t0 + i * row.dt), y(v));
            on = true;
          }
          ctx.stroke();
        }
        if (begun !== null && at !== null) {
          ctx.globalAlpha = 0.15;
          ctx.fillRect(x(begun), TOP, x(at) - x(begun), TALL);
        } else if (at !== null) ctx.fillRect(x(at), TOP, 1, TALL);
        ctx.restore();
        const k = at === null ? -1 : Math.round((at - row.t0) / row.dt);
        head.textContent = k >= 0 && k < row.n
          ? `${row.row} [${row.unit}] at ${text(row.t0 + k * row.dt, 0.01)} s: ${series.map((s) => `${s.name} ${s.values[k].toPrecision(4)}`).join(", ")}`
          : row.title;
      }
      return draw;
    }

    box.closest("details")?.addEventListener("toggle", all);
    window.addEventListener("resize", all);
    window.addEventListener("beforeprint", all);
    all();
  }

  document.querySelectorAll(".curves").forEach(run);
})();
