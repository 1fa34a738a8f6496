// Chooses the theme before anything is drawn, so that the page never flashes in the other one. Not a module: it must block.
(function () {
  let kept = null;
  try {
    kept = localStorage.getItem("lacet.theme");
  } catch {
    // storage may be switched off: the system's wish then holds
  }
  const dark = kept ? kept === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  document.documentElement.dataset.theme = dark ? "dark" : "light";
})();
