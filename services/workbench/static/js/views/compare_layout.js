/** What the view Compare shows beside the chosen row, as it stands in the address: rows, channels, formulas, overlays. */

const list = (text, separator = ",") => (text ? text.split(separator).filter(Boolean) : []);

/**
 * The layout of the state.
 * @param {object} state
 * @returns {{rows: string[], channels: string[], formulas: string[], overlays: Array<{version: number|null, run: string|null}>,
 *   xy: [string, string]|null, cursors: boolean, shares: boolean, centred: boolean}} null in an overlay: the present one
 */
export function layoutOf(state) {
  const without = new Set(list(state.without));
  const xy = list(state.xy, "~");
  return {
    rows: list(state.rows),
    channels: list(state.channels),
    formulas: list(state.formulas, ";"),
    overlays: list(state.over).map((one) => {
      const [version, run] = one.split("/");
      return { version: version ? Number(version) : null, run: run ? decodeURIComponent(run) : null };
    }),
    xy: xy.length === 2 ? xy : null,
    cursors: state.a !== null && state.b !== null,
    shares: !without.has("shares"),
    centred: !without.has("means"),
  };
}

const text = (items, separator = ",") => items.join(separator) || null;

/** The state's entries of a changed layout. */
export function patchOf(layout) {
  return {
    rows: text(layout.rows),
    channels: text(layout.channels),
    formulas: text(layout.formulas, ";"),
    over: text(layout.overlays.map(({ version, run }) => `${version ?? ""}/${run ? encodeURIComponent(run) : ""}`)),
    xy: layout.xy ? text(layout.xy, "~") : null,
    without: text([...(layout.shares ? [] : ["shares"]), ...(layout.centred ? [] : ["means"])]),
  };
}
