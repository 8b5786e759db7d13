// Controls of a report: colours, one of several at a time, sorted tables, downloads. No network.
(() => {
  "use strict";
  const root = document.documentElement;
  root.classList.add("js");
  const all = (selector, within = document) => [...within.querySelectorAll(selector)];
  const make = (tag, text, attributes = {}) => {
    const element = document.createElement(tag);
    element.textContent = text;
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    return element;
  };

  // Light, dark, or as the system has it; remembered where the browser allows it.
  const remembered = (value) => {
    try {
      if (value !== undefined) localStorage.setItem("oed-theme", value);
      return localStorage.getItem("oed-theme");
    } catch {
      return null;
    }
  };
  const themes = { auto: "Colours: as the system", light: "Colours: light", dark: "Colours: dark" };
  const theme = make("button", "", { id: "theme", type: "button" });
  const paint = (name) => {
    if (name === "auto") delete root.dataset.theme;
    else root.dataset.theme = name;
    theme.textContent = themes[name];
    theme.dataset.now = name;
  };
  paint(themes[remembered()] ? remembered() : "auto");
  theme.addEventListener("click", () => {
    const names = Object.keys(themes);
    const next = names[(names.indexOf(theme.dataset.now) + 1) % names.length];
    remembered(next);
    paint(next);
  });
  document.querySelector("nav").append(theme);

  // One of several parts at a time; choosers of one group go together.
  const groups = {};
  for (const box of all("[data-choose]")) {
    const parts = all(":scope > .choice", box);
    if (!parts.length) continue;
    const what = box.dataset.label;
    const select = make("select", "", { "aria-label": what });
    parts.forEach((part, i) => select.append(make("option", part.dataset.label, { value: i })));
    const show = (i) => {
      select.value = i;
      parts.forEach((part, j) => part.classList.toggle("chosen", i === j));
    };
    const group = (groups[box.dataset.choose] ??= []);
    group.push({ show, count: parts.length });
    const choose = (i) => group.forEach((one) => i < one.count && one.show(i));
    box.addEventListener("reveal", ({ detail }) => choose(parts.indexOf(detail)));
    const step = (by) => choose((Number(select.value) + by + parts.length) % parts.length);
    select.addEventListener("change", () => choose(Number(select.value)));
    const back = make("button", "‹", { type: "button", "aria-label": `Previous ${what}` });
    const on = make("button", "›", { type: "button", "aria-label": `Next ${what}` });
    back.addEventListener("click", () => step(-1));
    on.addEventListener("click", () => step(1));
    if (parts.length > 1) {
      const bar = make("div", "", { class: "chooser" });
      bar.append(back, select, on);
      box.prepend(bar);
    }
    show(0);
  }

  // What is wider than its place says so.
  const scrolled = new ResizeObserver((entries) => {
    for (const { target } of entries) {
      const wider = target.scrollWidth > target.clientWidth + 1;
      target.parentElement.classList.toggle("wider", wider);
      target.tabIndex = wider ? 0 : -1; // only what scrolls is a stop of the keyboard
    }
  });
  for (const one of all(".scroll")) scrolled.observe(one);

  // A link into a part that is hidden shows it.
  const reveal = () => {
    const target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (!target) return;
    const [details, part] = ["details", ".choice"].map((kind) => target.closest(kind));
    if (details) details.open = true;
    if (part) part.parentElement.dispatchEvent(new CustomEvent("reveal", { detail: part }));
    if (details || part) target.scrollIntoView();
  };
  addEventListener("hashchange", reveal);
  reveal();

  // Tables: sorted by a column, group by group.
  const worth = (cell) => cell.dataset.v ?? cell.textContent.trim();
  const compare = (a, b) => {
    const [x, y] = [Number(a), Number(b)];
    if (a !== "" && b !== "" && !Number.isNaN(x) && !Number.isNaN(y)) return x - y;
    return a.localeCompare(b, "en", { numeric: true });
  };
  const FILTERED = 8; // rows from which a table can be filtered
  for (const table of all("table[data-sort]")) {
    const named = all("tbody tr:not(.group)", table);
    if (named.length >= FILTERED && !named[0].cells[0].classList.contains("n")) {
      const label = make("label", "Filter by name ", { class: "filter" });
      const input = make("input", "", { type: "search", size: 14 });
      label.append(input);
      table.closest(".scroll").before(label);
      input.addEventListener("input", () => {
        const wanted = input.value.trim().toLowerCase();
        for (const row of named) row.hidden = !row.cells[0].textContent.toLowerCase().includes(wanted);
      });
    }
    all("thead th", table).forEach((head, column) => {
      const button = make("button", head.textContent, { type: "button" });
      head.replaceChildren(button);
      button.addEventListener("click", () => {
        const down = head.getAttribute("aria-sort") === "ascending";
        all("thead th", table).forEach((other) => other.removeAttribute("aria-sort"));
        head.setAttribute("aria-sort", down ? "descending" : "ascending");
        for (const body of table.tBodies) {
          const rows = [...body.rows].filter((row) => !row.classList.contains("group"));
          const known = (row) => !["", "–"].includes(worth(row.cells[column]));
          rows.sort((p, q) => {
            if (known(p) !== known(q)) return known(p) ? -1 : 1; // what is not known comes last
            const order = compare(worth(p.cells[column]), worth(q.cells[column]));
            return down ? -order : order;
          });
          body.append(...rows);
        }
      });
    });
  }

  // Downloads, made on the page.
  const save = (name, url) => {
    const link = make("a", "", { href: url, download: name });
    document.body.append(link);
    link.click();
    link.remove();
  };
  const saveText = (name, text, type) => {
    const url = URL.createObjectURL(new Blob([text], { type }));
    save(name, url);
    setTimeout(() => URL.revokeObjectURL(url), 10000);
  };
  // What is struck out on the page must not pass for a number elsewhere; ranges stay words.
  const plain = (text) => text.trim().replace(/\s+/g, " ").replaceAll("\u2212", "-");
  const told = (cell) => {
    if (cell.querySelector("s")) return `struck out: ${worth(cell)}`;
    return "words" in cell.dataset ? plain(cell.textContent) : worth(cell);
  };
  const latex = (table) => {
    const escaped = (text) =>
      text.replace(/[&%$#_{}]/g, "\\$&").replaceAll("~", "\\textasciitilde{}").replaceAll("^", "\\textasciicircum{}");
    const powers = (text) =>
      text
        .replace(/×\s10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)/g, (_, digits) => `$\\times 10^{${ascii(digits)}}$`)
        .replace(/([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)/g, (_, digits) => `$^{${ascii(digits)}}$`)
        .replaceAll("−", "$-$").replaceAll("±", "$\\pm$").replaceAll("°", "$^\\circ$").replaceAll("≥", "$\\ge$")
        .replaceAll("∞", "$\\infty$").replace(/[µμ]/g, "$\\mu$");
    const ascii = (digits) => [...digits].map((one) => "-0123456789"["⁻⁰¹²³⁴⁵⁶⁷⁸⁹".indexOf(one)]).join("");
    const cell = (one) => {
      const text = powers(escaped(one.textContent.trim().replace(/\s+/g, " ")));
      return one.querySelector("s") ? `\\emph{${text}}` : text;
    };
    const heads = all("thead th", table);
    const line = (cells) => `  ${cells.map(cell).join(" & ")} \\\\`;
    const rows = all("tbody tr:not([hidden])", table).map((row) =>
      row.classList.contains("group")
        ? `  \\multicolumn{${heads.length}}{l}{${cell(row.cells[0])}} \\\\`
        : line([...row.cells]));
    const spec = heads.map((head) => (head.classList.contains("n") ? "r" : "l")).join("");
    const caption = escaped(table.caption.textContent.trim().replace(/\s+/g, " "));
    return [
      `% ${caption}`, `\\begin{tabular}{${spec}}`, "  \\toprule", line(heads), "  \\midrule", ...rows,
      "  \\bottomrule", "\\end{tabular}", "",
    ].join("\n");
  };
  const csv = (table) => {
    const quoted = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
    // A spreadsheet takes what begins so for a formula, unless an apostrophe marks it as text.
    const inert = (text) => (/^[=+@-]/.test(text) && Number.isNaN(Number(text)) ? `'${text}` : text);
    const cell = (text) => quoted(inert(text.trim().replace(/\s+/g, " ")));
    const line = (cells) => cells.map(cell).join(",");
    const rows = all("tbody tr:not(.group, [hidden])", table);
    const head = all("thead th", table).map((cell) => cell.textContent);
    return [head, ...rows.map((row) => [...row.cells].map(told))].map(line).join("\r\n") + "\r\n";
  };
  const drawing = (svg) => {
    // In light colours, for papers; they are those of the page's light theme.
    const copy = svg.cloneNode(true);
    copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
    const [, , width, height] = copy.getAttribute("viewBox").split(" ");
    const point = svg.dataset.robot ? width / 240 : 1; // pictures of robots are in metres
    copy.setAttribute("width", `${width / point}pt`);
    copy.setAttribute("height", `${height / point}pt`);
    copy.removeAttribute("style");
    const canvas = svg.parentElement.querySelector(":scope > canvas"); // surfaces below the lines
    if (canvas) {
      copy.querySelectorAll(":not(.tool, .marks, text)").forEach((path) => path.remove());
      const [x, y] = copy.getAttribute("viewBox").split(" ").map(Number);
      const shape = canvas.width / canvas.height;
      const [across, down] = [Math.max(width, height * shape), Math.max(height, width / shape)];
      const corner = { x: x - (across - width) / 2, y: y - (down - height) / 2 };
      const place = { ...corner, width: across, height: down, href: canvas.toDataURL() };
      const image = document.createElementNS("http://www.w3.org/2000/svg", "image");
      for (const [name, value] of Object.entries(place)) image.setAttribute(name, value);
      copy.prepend(image);
    }
    copy.setAttribute("font-family", "Arial, Helvetica, sans-serif");
    let text = new XMLSerializer().serializeToString(copy);
    for (const [name, colour] of Object.entries(LIGHT)) text = text.replaceAll(`var(--${name})`, colour);
    return text;
  };
  for (const tool of all("[data-copy]")) {
    tool.addEventListener("click", async () => {
      const holder = tool.closest(".sheet");
      const text = latex(holder.querySelector("table"));
      try {
        await navigator.clipboard.writeText(text);
        tool.textContent = "copied";
      } catch {
        saveText(`${holder.id}.tex`, text, "application/x-tex"); // where pages must not copy
      }
      setTimeout(() => { tool.textContent = "LaTeX"; }, 2000);
    });
  }
  for (const tool of all("[data-save]")) {
    tool.addEventListener("click", () => {
      const holder = tool.closest("figure, .sheet, .choice");
      const name = `${holder.id || "figure"}`;
      const [table, svg, image] = ["table", "svg", "img"].map((tag) => holder.querySelector(tag));
      if (tool.dataset.save === "csv") saveText(`${name}.csv`, csv(table), "text/csv");
      else if (svg) saveText(`${name}.svg`, drawing(svg), "image/svg+xml");
      else save(`${name}.png`, image.src);
    });
  }
})();
