// The order of search results: pages for people at a bench before those for people who change the program.
// With var, as Sphinx declares it in searchtools.js.
var ORDER = [
  ["docs/glossary", 10], ["docs/how-to/coming_from", 0], ["docs/how-to/", 4], ["README", 2],
  ["docs/decisions/", -20], ["CHANGELOG", -20],
];

var Scorer = {
  objNameMatch: 11, objPartialMatch: 6, objPrio: {0: 15, 1: 5, 2: -5}, objPrioDefault: 0, // as Sphinx has them
  title: 15, partialTitle: 7, term: 5, partialTerm: 2,
  score: ([page, , , , score]) => score + (ORDER.find(([beginning]) => page.startsWith(beginning)) ?? ["", 0])[1],
};
