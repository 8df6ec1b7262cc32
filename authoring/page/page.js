// The page around one drawing: tool bar, search, details beside the pointer and in the panel.

(() => {
  const chart = JSON.parse(document.getElementById("chart").textContent);
  const byId = (id) => document.getElementById(id);
  const drawing = new PicktreeDrawing(byId("stage"), chart, { expand: chart.expand });
  window.picktreeDrawing = drawing;
  const panel = byId("panel");
  const hint = byId("hint");
  const search = byId("search");
  let matches = [];
  let match = -1;

  drawing.onselect = (item) => {
    byId("details").innerHTML = details(item);
    show(true);
    history.replaceState(null, "", `#${encodeURI(item.path)}`);
  };

  // Details.

  function show(shown) {
    panel.hidden = !shown;
    const { width, height } = panel.getBoundingClientRect();
    const below = width > innerWidth - 40;
    drawing.covered = { right: below ? 0 : width && width + 12, bottom: below ? height : 0 };
  }

  function details(item) {
    const { node } = item;
    const status = drawing.statuses[item.path];
    const rows = [`<h2>${escaped(node.title)}</h2><p class="kind">${escaped(node.meaning)}</p>`];
    if (status) rows.push(`<p class="status">${escaped(status)}</p>`);
    for (const paragraph of node.doc.split("\n\n").filter(Boolean)) {
      rows.push(`<p>${escaped(paragraph)}</p>`);
    }
    const entries = [
      ["ports", node.ports],
      ["by default", node.defaults],
      ["before", node.before],
      ["after", node.after],
    ];
    for (const [title, found] of entries) if (found.length) rows.push(table(title, found));
    const lists = [
      ["may fail with", node.causes.join(", ")],
      ["uses", node.uses.join(", ")],
      ["breakpoint", node.breakpoint],
      ["path", item.path],
      ["place", node.place],
    ].filter(([, text]) => text);
    rows.push(
      `<dl>${lists.map(([key, text]) => `<dt>${key}</dt><dd>${escaped(text)}</dd>`).join("")}</dl>`,
    );
    return rows.join("");
  }

  function table(title, entries) {
    const rows = entries.map(
      ({ key, value, role, doc }) =>
        `<tr><th>${escaped(key)}</th><td><code class="${role}">${role === "output" ? "→ " : ""}${escaped(value)}</code>${
          doc ? `<small>${escaped(doc)}</small>` : ""
        }</td></tr>`,
    );
    return `<table><caption>${title}</caption>${rows.join("")}</table>`;
  }

  // The hint beside the pointer; a finger has none.

  drawing.svg.addEventListener("pointermove", (event) => {
    const item = event.pointerType === "mouse" && !event.buttons ? drawing.itemAt(event.target) : null;
    if (!item || event.target.closest(".sheet")) {
      hint.hidden = true;
      return;
    }
    if (hint.dataset.path !== item.path || hint.hidden) {
      hint.dataset.path = item.path;
      hint.innerHTML = details(item);
      hint.hidden = false;
    }
    const { width, height } = hint.getBoundingClientRect();
    const x = event.clientX + 18 + width > innerWidth ? event.clientX - 18 - width : event.clientX + 18;
    const y = Math.min(event.clientY + 14, innerHeight - height - 8);
    hint.style.transform = `translate(${Math.max(x, 8)}px, ${Math.max(y, 8)}px)`;
  });
  for (const gone of ["pointerleave", "pointerdown", "wheel"]) {
    drawing.svg.addEventListener(gone, () => (hint.hidden = true), { passive: true });
  }

  // Search.

  function look(step) {
    if (!matches.length) return;
    match = (match + step + matches.length) % matches.length;
    drawing.select(matches[match], { centre: true });
    count();
  }

  function count() {
    const words = search.value.trim();
    byId("count").textContent = !words ? "" : matches.length ? `${match + 1} of ${matches.length}` : "none";
  }

  search.addEventListener("input", () => {
    matches = drawing.search(search.value);
    match = -1;
    if (matches.length) look(1);
    count();
  });
  search.addEventListener("keydown", (event) => {
    if (event.key === "Enter") {
      event.preventDefault();
      look(event.shiftKey ? -1 : 1);
    }
    if (event.key === "Escape") {
      search.value = "";
      matches = drawing.search("");
      count();
      drawing.select(drawing.selected, { focus: true });
    }
  });

  // Buttons and keys.

  const buttons = {
    next: () => look(1),
    previous: () => look(-1),
    open: () => drawing.openAll(true),
    close: () => drawing.openAll(false),
    fit: () => drawing.fit(),
    larger: () => drawing.scaleBy(1.3),
    smaller: () => drawing.scaleBy(1 / 1.3),
    help: () => (byId("legend").hidden = !byId("legend").hidden),
    hide: () => show(false),
  };
  for (const [id, action] of Object.entries(buttons)) byId(id).addEventListener("click", action);
  const keys = { "+": "larger", "=": "larger", "-": "smaller", 0: "fit", e: "open", c: "close", "?": "help" };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target === search) return;
    if (event.key === "/") {
      event.preventDefault();
      search.focus();
    } else if (event.key === "Escape") {
      show(false);
      byId("legend").hidden = true;
    } else if (keys[event.key]) {
      buttons[keys[event.key]]();
    }
  });

  const wanted = decodeURI(location.hash.slice(1));
  if (wanted && drawing.root.find(wanted)) drawing.select(wanted, { centre: true });
})();
