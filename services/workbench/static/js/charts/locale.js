// Loaded before uPlot, which makes an Intl.NumberFormat of the browser's language at load: where that is no valid tag
// (`en-US@posix` on a machine with LANG=C) the constructor throws and nothing would be drawn.

/** A language that number formatting accepts: the browser's own where it is valid, British English otherwise. */
export function validLanguage(language) {
  try {
    new Intl.NumberFormat(language);
    return language;
  } catch {
    return "en-GB";
  }
}

const language = validLanguage(navigator.language);
if (language !== navigator.language) {
  Object.defineProperty(navigator, "language", { configurable: true, get: () => language });
}
