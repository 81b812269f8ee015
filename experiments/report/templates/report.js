"use strict";
/* Tables sort by a column at a click: numbers by value, then words; once more turns it round. */

for (const table of document.querySelectorAll(".table:not(.sideways) table")) {
  const heads = [...[...table.tHead.rows].at(-1).cells], body = table.tBodies[0];
  const key = (row, i) => {
    const { dataset, textContent } = row.cells[i];
    return "value" in dataset ? Number(dataset.value.replace("inf", "Infinity")) : textContent;
  };
  const order = (a, b) => {
    if (typeof a === "number" && typeof b === "number") {
      return Number.isNaN(a) - Number.isNaN(b) || a - b;
    }
    if (typeof a !== typeof b) return typeof a === "number" ? -1 : 1;
    return a.localeCompare(b, "en", { numeric: true });
  };
  heads.forEach((head, i) => head.querySelector("button").addEventListener("click", () => {
    const way = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    for (const other of heads) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", way > 0 ? "ascending" : "descending");
    body.append(...[...body.rows].sort((a, b) => way * order(key(a, i), key(b, i))));
  }));
}
