/* Order of search results: pages to be read before those that are looked up in. Values beside `score` are Sphinx's own. */
const LOOKED_UP = ["reference/", "benchmarks/", "decisions/"];
var Scorer = {
  score: ([page, title, anchor, about, score]) => (LOOKED_UP.some((folder) => page.startsWith(folder)) ? score / 10 : score),
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
