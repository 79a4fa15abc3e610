"use strict";
// The rule tables of the controller that acts, with the rules lit that fire, and their labels to change.
const rules = (() => {
  const section = document.getElementById("rules");
  const place = document.getElementById("tables");
  const collect = document.getElementById("collect");
  const apply = document.getElementById("apply");
  const discard = document.getElementById("discard");
  const restore = document.getElementById("rules-default");
  const CORNERS = [[0, 0, "w00"], [0, 1, "w01"], [1, 0, "w10"], [1, 1, "w11"]];
  let tables = [];
  let base = ""; // labels and tables as they are shown
  const changed = new Map(); // "rules.kp" -> rows as they are to be
  let lit = [];
  let shown = "";

  const has = (name) => Boolean(known.nodes.get(name)?.rules);
  // Of runs side by side the one that is shown; otherwise of the controller that acts, or acted last.
  // Beside a law without gains, as one's own may be, the rules of another are foreign.
  const owner = () => {
    const { acting } = known.run;
    const foreign = acting.length && acting.every((name) => !("kp" in (known.nodes.get(name)?.terms ?? {})));
    return (known.runs[0].name || foreign ? acting : [...acting, shown, ...known.nodes.keys()]).find(has);
  };
  const rowsOf = (name) => changed.get(name) ?? known.nodes.get(shown).parameters[name];

  // The default rules are for the default labels: they do not fit a base of another size.
  const fits = (name) => {
    const usual = known.declared.get(shown)?.[name]?.default;
    const { error, rate } = known.nodes.get(shown).rules;
    return usual?.length === error.length && cellsOf(usual[0]).length === rate.length;
  };
  const cellsOf = (text) => text.split(/\s+/).filter(Boolean);
  const click = (name, labels, row, column, button) => {
    const now = labels.indexOf(cellsOf(rowsOf(name)[row])[column]);
    if (now < 0) write(button, (text) => put(name, row, column, text));
    else put(name, row, column, labels[(now + 1) % labels.length]);
  };
  // A number is written over, by another or by a label: Enter puts it, Escape leaves the cell as it is.
  const write = (button, done) => {
    const field = document.createElement("input");
    const before = button.textContent;
    field.type = "text";
    field.value = before;
    field.setAttribute("aria-label", button.getAttribute("aria-label"));
    field.addEventListener("keydown", (event) => {
      if (event.key === "Escape") field.value = before;
      if (event.key !== "Enter" && event.key !== "Escape") return;
      event.preventDefault(); // Enter would click the button
      button.hidden = false;
      button.focus();
    });
    field.addEventListener("blur", () => {
      const text = field.value.trim();
      field.remove();
      button.hidden = false;
      if (text && text !== before && button.isConnected) done(text);
    }, { once: true });
    button.hidden = true;
    button.after(field);
    field.select();
  };
  const put = (name, row, column, text) => {
    const rows = rowsOf(name).map(cellsOf);
    rows[row][column] = text;
    changed.set(name, rows.map((cells) => cells.join(" ")));
    if (collect.checked) show();
    else send();
  };
  const send = async () => {
    const values = Object.fromEntries(changed);
    const { ok, text } = await edits.set(shown, values);
    alarm.say(ok ? "" : text, "asked");
    for (const [name, rows] of Object.entries(values)) if (changed.get(name) === rows) changed.delete(name);
    show();
  };
  apply.addEventListener("click", send);
  discard.addEventListener("click", () => {
    changed.clear();
    show();
  });
  restore.addEventListener("click", () => {
    changed.clear();
    for (const { name } of tables.filter((table) => fits(table.name))) changed.set(name, known.declared.get(shown)[name].default);
    send();
  });

  // A table is one stop of the Tab key: arrows, Home and End lead from cell to cell, with Ctrl to the corners.
  const roam = (table, cells) => {
    const [bottom, right] = [cells.length - 1, cells[0].length - 1];
    let stop = cells[0][0].firstChild;
    cells.flat().forEach((cell) => { cell.firstChild.tabIndex = cell.firstChild === stop ? 0 : -1; });
    table.addEventListener("focusin", ({ target }) => {
      if (target.localName !== "button") return;
      stop.tabIndex = -1;
      stop = target;
      stop.tabIndex = 0;
    });
    table.addEventListener("keydown", (event) => {
      const { key, target, ctrlKey } = event;
      if (target.localName !== "button" || event.altKey || event.metaKey) return;
      const row = cells.findIndex((line) => line.includes(target.parentElement));
      const column = cells[row].indexOf(target.parentElement);
      const to = {
        ArrowLeft: [row, column - 1], ArrowRight: [row, column + 1], ArrowUp: [row - 1, column], ArrowDown: [row + 1, column],
        Home: [ctrlKey ? 0 : row, 0], End: [ctrlKey ? bottom : row, right],
      }[key];
      if (!to) return;
      event.preventDefault();
      cells[to[0]]?.[to[1]]?.firstChild.focus();
    });
  };

  const make = ({ name, title, labels }, { error, rate }) => {
    const box = document.createElement("div");
    box.className = "rule-table";
    const table = document.createElement("table");
    table.className = "rules";
    table.setAttribute("role", "grid");
    if (rate.length > 9) table.style.minWidth = `${2.4 * rate.length}rem`;
    const caption = table.createCaption();
    caption.textContent = `${title}: rows e, columns ė`;
    const head = table.createTHead().insertRow();
    head.insertCell();
    for (const label of rate) {
      const cell = document.createElement("th");
      cell.scope = "col";
      cell.textContent = label;
      head.append(cell);
    }
    const body = table.createTBody();
    const cells = error.map((label, row) => {
      const line = body.insertRow();
      const heading = document.createElement("th");
      heading.scope = "row";
      heading.textContent = label;
      line.append(heading);
      return rate.map((_, column) => {
        const cell = line.insertCell();
        const button = document.createElement("button");
        button.type = "button";
        button.addEventListener("click", () => click(name, labels, row, column, button));
        cell.append(button);
        return cell;
      });
    });
    roam(table, cells);
    const dot = document.createElement("div");
    dot.className = "rule-dot";
    dot.hidden = true;
    box.append(table, dot);
    place.append(box);
    return { name, title, cells, dot };
  };

  // The labels, as they are or are to be.
  const show = () => {
    const name = owner();
    section.hidden = !name;
    if (!name) return;
    const { rules: labels } = known.nodes.get(name);
    if (name !== shown || JSON.stringify(labels) !== base) {
      changed.clear();
      base = JSON.stringify(labels);
      place.replaceChildren();
      lit = [];
      tables = labels.tables.map((table) => make(table, labels));
    }
    shown = name;
    document.getElementById("rules-of").textContent = name;
    const now = known.nodes.get(name).parameters;
    const declared = known.declared.get(name);
    const fixed = !known.control_allowed;
    let edited = 0;
    for (const { name: table, title, cells } of tables) {
      const rows = rowsOf(table).map(cellsOf);
      const before = now[table].map(cellsOf);
      const usual = (fits(table) ? declared[table].default : now[table]).map(cellsOf);
      cells.forEach((line, row) => line.forEach((cell, column) => {
        const button = cell.firstChild;
        const label = rows[row]?.[column] ?? "";
        if (button.textContent !== label) button.textContent = label;
        button.disabled = fixed;
        const differs = label !== usual[row]?.[column];
        edited += differs;
        const note = differs ? `, by default ${usual[row]?.[column]}` : "";
        button.setAttribute("aria-label", `${title} at e ${labels.error[row]}, ė ${labels.rate[column]}: ${label}${note}`);
        cell.toggleAttribute("data-edited", differs);
        cell.toggleAttribute("data-changed", label !== before[row]?.[column]);
      }));
    }
    apply.disabled = discard.disabled = !changed.size;
    restore.disabled = fixed || !edited;
  };

  // The rules that fire at a time, and the operating point between them.
  const draw = (time) => {
    if (section.hidden || !tables.length) return;
    const { control } = known;
    const at = control.row(time);
    const value = (name) => control.value(name, at);
    const fired = known.firing(at);
    const { row, column } = fired;
    const there = Number.isFinite(row);
    // All is measured before anything is changed: the page is laid out once.
    const places = there ? tables.map(({ cells }) => {
      const { offsetLeft, offsetTop, offsetWidth, offsetHeight } = cells[row][column];
      return [offsetLeft + (0.5 + fired.w01 + fired.w11) * offsetWidth, offsetTop + (0.5 + fired.w10 + fired.w11) * offsetHeight];
    }) : [];
    for (const cell of lit) {
      cell.style.removeProperty("--weight");
      cell.removeAttribute("data-lit");
    }
    lit = [];
    tables.forEach(({ cells, dot }, index) => {
      dot.hidden = !there;
      if (!there) return;
      for (const [down, right, weight] of CORNERS) {
        const cell = cells[row + down]?.[column + right];
        if (!cell || !(fired[weight] > 0)) continue;
        cell.style.setProperty("--weight", fired[weight]);
        cell.setAttribute("data-lit", "");
        lit.push(cell);
      }
      [dot.style.left, dot.style.top] = places[index].map((place) => `${place}px`);
    });
    const gains = [["kp", "Kp"], ["ki", "Ki"], ["kd", "Kd"], ["alpha", "α"]]
      .filter(([name]) => Number.isFinite(value(name))).map(([name, title]) => `${title} ${showNumber(value(name))}`);
    const words = there && gains.length ? `Now: ${gains.join(", ")}.` : "";
    const line = document.getElementById("gains-now");
    if (line.textContent !== words) line.textContent = words;
  };
  return { show, draw };
})();
