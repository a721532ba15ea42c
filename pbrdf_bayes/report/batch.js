(() => {
  const table = document.getElementById("table");
  const body = table.tBodies[0];
  const rows = [...body.rows];
  const heads = [...table.tHead.rows[0].cells];
  const order = { FAIL: 0, WARN: 1, PASS: 2, REJECT: 0, UNDECIDED: 1, ACCEPT: 2, "": 3 };
  const cellOf = (row, column) => {
    let at = 0;
    for (const cell of row.cells) {
      if (at === column) return cell.colSpan > 1 ? null : cell;
      at += cell.colSpan;
    }
    return null;
  };
  const key = (row, column, kind) => {
    const cell = cellOf(row, column);
    if (!cell || cell.dataset.key === undefined) return null;
    const text = cell.dataset.key;
    if (kind === "verdict") return order[text];
    if (kind === "number") return text === "" ? null : Number(text);
    return text.toLowerCase();
  };
  const sort = (column, kind, down) => {
    const sign = down ? -1 : 1;
    const keyed = rows.map((row, at) => ({ row, at, value: key(row, column, kind) }));
    keyed.sort((a, b) => {
      if (a.value === null || b.value === null)
        return (a.value === null) - (b.value === null) || a.at - b.at;
      const way = typeof a.value === "string" ? a.value.localeCompare(b.value, "en", { numeric: true }) : a.value - b.value;
      return sign * way || a.at - b.at;
    });
    body.append(...keyed.map(({ row }) => row));
  };
  heads.forEach((head, column) => {
    const kind = head.dataset.sort;
    if (!kind) return;
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.firstElementChild.childNodes);
    head.replaceChildren(button);
    head.setAttribute("aria-sort", column === 0 ? "ascending" : "none");
    button.addEventListener("click", () => {
      const down = head.getAttribute("aria-sort") === "ascending";
      heads.forEach((other) => other.dataset.sort && other.setAttribute("aria-sort", "none"));
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      sort(column, kind, down);
    });
  });
  const form = document.querySelector("form.tools");
  const [words, verdict, conformity, shown] = ["words", "verdict", "conformity", "shown"].map((id) => document.getElementById(id));
  const filter = () => {
    const wanted = words.value.toLowerCase();
    let count = 0;
    for (const row of rows) {
      const head = row.querySelector("th");
      const name = `${head.dataset.key} ${head.querySelector(".what").textContent}`.toLowerCase();
      const fits =
        name.includes(wanted) &&
        (!verdict.value || row.dataset.verdict === verdict.value) &&
        (!conformity || !conformity.value || row.dataset.conformity === conformity.value);
      row.hidden = !fits;
      count += fits;
    }
    shown.textContent = `${count} of ${rows.length} shown`;
  };
  form.hidden = false;
  form.addEventListener("input", filter);
  form.addEventListener("submit", (event) => event.preventDefault());
  filter();
})();
