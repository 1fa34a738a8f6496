// Charts of one key share a time window and a cursor.

const groups = new Map();

/** A time window and a cursor that several charts share. Times are in seconds. */
class Link {
  constructor(key) {
    this.key = key;
    this.members = new Set();
    this.window = null; // null: everything
    this.cursor = null;
    this.cursorIn = null; // window in which the cursor was set
    this.marks = []; // times that stay marked: [{t, label}]
    this.queued = false;
    this.notifies = false;
    this.following = false;
  }

  /** @returns {[number, number]} first and last time of all members. */
  get extent() {
    let low = Infinity;
    let high = -Infinity;
    for (const member of this.members) {
      if (!(member.extent[1] > member.extent[0])) continue;
      low = Math.min(low, member.extent[0]);
      high = Math.max(high, member.extent[1]);
    }
    return low < high ? [low, high] : [0, 1];
  }

  /** @returns {[number, number]} what is shown. */
  get shown() {
    return this.window ?? this.extent;
  }

  /** @returns {number} lines of all members. */
  get lines() {
    let sum = 0;
    for (const member of this.members) sum += member.lines.length;
    return sum;
  }

  join(member) {
    this.members.add(member);
  }

  leave(member) {
    this.members.delete(member);
    if (!this.members.size) groups.delete(this.key);
  }

  /**
   * Shows a window in all members; it is kept inside the data and no narrower than a few samples.
   * @param {number} t0
   * @param {number} t1
   * @param {boolean} [notify] whether listeners (onZoom) are called: not when they asked for it.
   */
  setWindow(t0, t1, notify = true) {
    const [low, high] = this.extent;
    let least = Infinity;
    for (const member of this.members) least = Math.min(least, member.least);
    if (!Number.isFinite(least)) least = 0.01;
    let a = Math.min(t0, t1);
    let b = Math.max(t0, t1);
    if (!Number.isFinite(a) || !Number.isFinite(b)) [a, b] = [low, high];
    if (b - a < least) {
      const middle = (a + b) / 2;
      [a, b] = [middle - least / 2, middle + least / 2];
    }
    if (b - a >= high - low) [a, b] = [low, high];
    else if (a < low) [a, b] = [low, low + b - a];
    else if (b > high) [a, b] = [high - (b - a), high];
    const whole = a <= low && b >= high;
    this.window = whole ? null : [a, b];
    this.notifies = this.notifies || notify;
    for (const member of this.members) member.stale = true;
    this.queue();
  }

  /** Redraws what is stale in the next frame: several wheel or touch events, or answers, make one redraw. */
  queue() {
    if (this.queued) return;
    this.queued = true;
    requestAnimationFrame(() => {
      this.queued = false;
      this.show();
    });
  }

  /**
   * Sets the cursor in pictures that were drawn anew, a frame later: the pictures come first. It keeps its place on the
   * screen, where the pointer is, and so has another time in another window.
   */
  follow() {
    if (this.cursor === null || this.following) return;
    this.following = true;
    requestAnimationFrame(() => {
      this.following = false;
      if (this.cursor === null) return;
      const [[a, b], [c, d]] = [this.shown, this.cursorIn];
      this.setCursor(a + ((this.cursor - c) / (d - c)) * (b - a));
    });
  }

  /** Shows everything. */
  reset() {
    this.setWindow(-Infinity, Infinity);
  }

  show() {
    const [a, b] = this.shown;
    for (const member of this.members) member.refresh();
    if (this.notifies) for (const member of [...this.members]) member.onZoom?.(a, b, this.window === null);
    this.notifies = false;
  }

  /** Marks times in all members, in place of those before. */
  setMarks(marks) {
    this.marks = marks;
    for (const member of this.members) member.u?.redraw(false);
  }

  /** Zooms by a factor (below 1: closer) about a time. */
  zoom(factor, about) {
    const [a, b] = this.shown;
    this.setWindow(about - (about - a) * factor, about + (b - about) * factor);
  }

  /** Moves the window by a part of its width. */
  pan(part) {
    const [a, b] = this.shown;
    const by = part * (b - a);
    const [low, high] = this.extent;
    const kept = Math.max(low - a, Math.min(high - b, by));
    this.setWindow(a + kept, b + kept);
  }

  /**
   * Shows the cursor in all members.
   * @param {number|null} t
   * @param {object} [from] the member the pointer is over: it has its cursor already.
   */
  setCursor(t, from = null) {
    this.cursor = t;
    this.cursorIn = this.shown;
    for (const member of this.members) member.showCursor(t, member === from);
  }
}

/**
 * The link of a key, made when it is first asked for. An empty key links nothing: each call makes a link of its own.
 * @param {string} key
 * @returns {Link}
 */
export function link(key) {
  if (!key) return new Link("");
  if (!groups.has(key)) groups.set(key, new Link(key));
  return groups.get(key);
}
