// Wheel, touch and keys on a plot, made into a time window and a cursor.

const STEP = 1.25; // zoom of one step of the wheel or one key

/**
 * Lets a plot be zoomed and moved.
 * @param {HTMLElement} over the plotting area: pointer positions are taken in it.
 * @param {HTMLElement} focus the element that has the keyboard.
 * @param {import('./linked_axes.js').Link} shared
 * @param {{timeAt: (px: number) => number, spacing: () => number}} place
 * @returns {() => void} takes the listeners off.
 */
export function gestures(over, focus, shared, place) {
  const end = new AbortController();
  const signal = end.signal;
  const at = (event) => place.timeAt(event.clientX - over.getBoundingClientRect().left);

  over.addEventListener("wheel", (event) => {
    const sideways = event.shiftKey ? event.deltaY || event.deltaX : event.deltaX;
    if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) {
      if (!shared.window) return;
      event.preventDefault();
      shared.pan(Math.sign(sideways) * 0.1);
      return;
    }
    // Zoomed out already: the page scrolls on.
    if (event.deltaY > 0 && !shared.window) return;
    event.preventDefault();
    shared.zoom(event.deltaY > 0 ? STEP : 1 / STEP, at(event));
  }, { passive: false, signal });

  touches(over, shared, signal, at);
  focus.addEventListener("keydown", (event) => keys(event, shared, place), { signal });
  return () => end.abort();
}

/** One finger moves the window (up and down it scrolls the page), two fingers zoom, a tap sets the cursor. */
function touches(over, shared, signal, at) {
  const down = new Map();
  let begun = null;
  const begin = () => {
    const xs = [...down.values()];
    begun = { window: shared.shown, left: Math.min(...xs), right: Math.max(...xs) };
  };
  const lift = (event) => {
    if (!down.delete(event.pointerId)) return;
    if (down.size) begin();
    else begun = null;
  };
  over.addEventListener("pointerdown", (event) => {
    if (event.pointerType !== "touch") return;
    down.set(event.pointerId, event.clientX);
    over.setPointerCapture(event.pointerId);
    shared.setCursor(at(event));
    begin();
  }, { signal });
  over.addEventListener("pointermove", (event) => {
    if (!down.has(event.pointerId)) return;
    down.set(event.pointerId, event.clientX);
    const box = over.getBoundingClientRect();
    const xs = [...down.values()];
    const [left, right] = [Math.min(...xs), Math.max(...xs)];
    const [a, b] = begun.window;
    const span = b - a;
    if (down.size === 1) {
      if (!shared.window) {
        shared.setCursor(at(event));
        return;
      }
      const by = ((begun.left - left) / box.width) * span;
      const [low, high] = shared.extent;
      const kept = Math.max(low - a, Math.min(high - b, by));
      shared.setWindow(a + kept, b + kept);
      return;
    }
    const scale = Math.max(20, begun.right - begun.left) / Math.max(20, right - left);
    const held = a + (((begun.left + begun.right) / 2 - box.left) / box.width) * span;
    const t0 = held - (((left + right) / 2 - box.left) / box.width) * span * scale;
    shared.setWindow(t0, t0 + span * scale);
  }, { signal });
  over.addEventListener("pointerup", lift, { signal });
  over.addEventListener("pointercancel", lift, { signal });
}

/** Arrows move the cursor, with shift the window; plus, minus and 0 zoom. Keys that are used go no further. */
function keys(event, shared, place) {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const [a, b] = shared.shown;
  const now = shared.cursor ?? (a + b) / 2;
  const sign = event.key === "ArrowLeft" ? -1 : 1;
  switch (event.key) {
    case "ArrowLeft":
    case "ArrowRight":
      if (event.shiftKey) shared.pan(0.2 * sign);
      else shared.setCursor(Math.max(a, Math.min(b, now + sign * Math.max(place.spacing(), (b - a) / 200))));
      break;
    case "+":
    case "=":
      shared.zoom(1 / STEP, now);
      break;
    case "-":
      shared.zoom(STEP, now);
      break;
    case "0":
    case "Home":
      shared.reset();
      break;
    case "Escape":
      if (!shared.window) return;
      shared.reset();
      break;
    default:
      return;
  }
  event.preventDefault();
  event.stopPropagation();
}
