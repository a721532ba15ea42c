(() => {
  const table = document.getElementById("table");
  const body = table.tBodies[0];
  const rows = [...body.rows];
  const heads = [...table.tHead.rows[0].cells];
  // what was chosen is kept over a reload: by the tab, in a file as well
  const place = `batch ${location.pathname}`;
  const stored = (() => {
    try {
      return JSON.parse(sessionStorage.getItem(place)) || {};
    } catch {
      return {};
    }
  })();
  const keep = (found) => {
    Object.assign(stored, found);
    try {
      sessionStorage.setItem(place, JSON.stringify(stored));
    } catch {
      /* without a store nothing is kept */
    }
  };
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
  const sortBy = (column, down) => {
    heads.forEach((other) => other.dataset.sort && other.setAttribute("aria-sort", "none"));
    heads[column].setAttribute("aria-sort", down ? "descending" : "ascending");
    sort(column, heads[column].dataset.sort, down);
    keep({ column, down });
  };
  heads.forEach((head, column) => {
    const kind = head.dataset.sort;
    if (!kind) return;
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.firstElementChild.childNodes);
    head.replaceChildren(button);
    head.setAttribute("aria-sort", column === 0 ? "ascending" : "none");
    button.id = `by-${column}`;
    button.addEventListener("click", () => sortBy(column, head.getAttribute("aria-sort") === "ascending"));
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
  const fields = [words, verdict, conformity].filter(Boolean);
  for (const field of fields) field.value = (stored.fields || {})[field.id] ?? field.value;
  if (stored.column !== undefined && heads[stored.column]?.dataset.sort) sortBy(stored.column, stored.down);
  form.hidden = false;
  form.addEventListener("input", filter);
  form.addEventListener("submit", (event) => event.preventDefault());
  filter();
  const region = table.parentElement;
  region.scrollLeft = stored.left || 0;
  const focused = stored.focus && document.getElementById(stored.focus);
  if (focused) focused.focus({ preventScroll: true });
  if (focused === words && stored.caret) words.setSelectionRange(...stored.caret);
  addEventListener("pagehide", () => {
    const values = Object.fromEntries(fields.map((field) => [field.id, field.value]));
    const caret = [words.selectionStart, words.selectionEnd];
    keep({ fields: values, left: region.scrollLeft, focus: document.activeElement.id, caret });
  });
  // a batch that runs is loaded again, until its page stays the same for five minutes
  const { written } = document.body.dataset;
  if (!written) return;
  const now = Date.now();
  if (stored.written !== written) keep({ written, since: now });
  const minutes = Math.max(now - stored.since, now - Date.parse(written) - 3.6e6) / 6e4;
  if (minutes < 5) setTimeout(() => location.reload(), 15000);
  else document.getElementById("stale").hidden = false;
})();
