// A length in words: metres, or, where the page is told in feet, feet and inches.
const inUnits = (metres, digits) => {
  if (document.documentElement.dataset.units !== "ft") return `${metres.toFixed(digits)} m`;
  const inches = Math.abs(metres) / 0.0254;
  const sign = metres < 0 ? "-" : "";
  if (Number(inches.toFixed(1)) < 12) return `${sign}${inches.toFixed(Number(inches.toFixed(2)) >= 1 ? 1 : 2)} in`;
  if (inches / 12 >= 100) return `${sign}${Math.round(inches / 12).toLocaleString("en")} ft`;
  const eighths = Math.round(inches * 8);
  const part = ["", "1/8", "1/4", "3/8", "1/2", "5/8", "3/4", "7/8"][eighths % 8];
  const words = [Math.floor((eighths % 96) / 8) || "", part].filter(Boolean).join(" ");
  return `${sign}${Math.floor(eighths / 96)} ft${words && ` ${words} in`}`;
};
// Sorts a table by the column whose head is pressed; again: the other way. Empty cells stay last.
for (const table of document.querySelectorAll("table.sortable")) {
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) =>
    head.addEventListener("click", () => {
      const down = head.getAttribute("aria-sort") === "ascending";
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      const key = (row) => row.cells[column].dataset.key;
      const isNumber = head.classList.contains("num");
      const rows = [...table.tBodies[0].rows];
      rows.sort((a, b) => {
        const [x, y] = [key(a), key(b)];
        if (x === "" || y === "") return (x === "") - (y === "");
        const order = isNumber ? Number(x) - Number(y) : x.localeCompare(y, undefined, { numeric: true });
        return down ? -order : order;
      });
      table.tBodies[0].append(...rows);
    }),
  );
}

// On paper all sections are seen; on the screen those stay closed that were.
const folded = () => document.querySelectorAll("details.section:not([open])");
let opened = [];
addEventListener("beforeprint", () => {
  opened = [...folded()];
  opened.forEach((section) => (section.open = true));
});
addEventListener("afterprint", () => opened.forEach((section) => (section.open = false)));
