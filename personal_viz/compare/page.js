// Sorts, filters and pages the rows that are written in the page, and takes the means of chosen agents anew.
"use strict";
const PAGE = 100; // rows in the table at once: laying thousands out takes seconds
const isServed = location.protocol === "http:" || location.protocol === "https:";

function written(value, figure) {
  if (value === null) return "-";
  const rounded = Math.abs(value).toFixed(figure.digits);
  const sign = Number(rounded) === 0 ? "" : value < 0 ? "\u2212" : figure.isSigned ? "+" : "";
  return sign + rounded;
}

function mean(values) {
  return values.length ? values.reduce((sum, value) => sum + value, 0) / values.length : null;
}

class Table {
  constructor(section) {
    this.section = section;
    this.body = section.querySelector(".episodes tbody");
    this.buttons = [...section.querySelectorAll("thead button[data-key]")];
    const rest = section.querySelector("template.rest");
    this.rows = [...this.body.rows, ...(rest ? rest.content.querySelectorAll("tr") : [])].map((row) => this.read(row));
    this.shown = PAGE;
    this.status = section.querySelector(".count");
    this.more = section.querySelector(".more");
    this.more.addEventListener("click", () => { this.shown += PAGE; this.show(); });
    for (const button of this.buttons) button.addEventListener("click", () => this.sortBy(button.dataset.key));
    for (const field of section.querySelectorAll(".tools [data-filter]")) {
      field.addEventListener("input", () => { this.shown = PAGE; this.show(); });
    }
    section.querySelector("[data-agents]")?.addEventListener("input", (event) => this.takeMeans(event.target.value));
    this.makeSortField();
    const first = this.buttons.find((button) => button.classList.contains("down") || button.classList.contains("up"));
    [this.key, this.isDown] = first ? [first.dataset.key, first.classList.contains("down")] : [null, true];
    if (first) section.querySelector("[data-sort]").value = `${this.key}:${this.isDown ? "down" : "up"}`;
    section.querySelector(".tools").hidden = false;
    this.show();
  }

  read(row) {
    leadToViewer(row.querySelector("a.replay"));
    const keys = { split: Number(row.dataset.order), scene: row.dataset.scene, episode: row.dataset.episode };
    keys.who = Number(row.dataset.share);
    for (const cell of row.querySelectorAll("td[data-key]")) {
      keys[cell.dataset.key] = cell.dataset.value === "" ? null : Number(cell.dataset.value);
    }
    return { row, keys, text: null };
  }

  makeSortField() {
    const field = this.section.querySelector("[data-sort]");
    for (const button of [...this.buttons].reverse()) { // differences first
      for (const [end, words] of [[":down", "largest first"], [":up", "smallest first"]]) {
        field.add(new Option(`${button.dataset.label}, ${words}`, button.dataset.key + end));
      }
    }
    field.addEventListener("input", () => {
      const [key, end] = field.value.split(":");
      this.sortBy(key, end === "down");
    });
  }

  sortBy(key, isDown = key === this.key ? !this.isDown : !["split", "scene", "episode"].includes(key)) {
    this.key = key;
    this.isDown = isDown;
    const order = isDown ? -1 : 1;
    const names = new Intl.Collator("en", { numeric: true });
    this.rows.sort((one, other) => {
      const [a, b] = [one.keys[key], other.keys[key]];
      if (a === null || b === null) return (a === null) - (b === null); // what has no figure stays last
      return order * (typeof a === "string" ? names.compare(a, b) : a - b);
    });
    for (const button of this.buttons) {
      const isThis = button.dataset.key === key;
      button.classList.toggle("down", isThis && isDown);
      button.classList.toggle("up", isThis && !isDown);
      button.closest("th").removeAttribute("aria-sort");
    }
    const button = this.buttons.find((candidate) => candidate.dataset.key === key);
    button.closest("th").setAttribute("aria-sort", isDown ? "descending" : "ascending");
    this.section.querySelector("[data-sort]").value = `${key}:${isDown ? "down" : "up"}`;
    this.show();
  }

  has(entry, text) {
    if (!text) return true;
    entry.text ??= entry.row.textContent.toLowerCase();
    return entry.text.includes(text);
  }

  passes(entry) {
    const chosen = (name) => this.section.querySelector(`[data-filter="${name}"]`)?.value ?? "";
    const gap = entry.keys["difference-sr"] ?? null;
    const outcome = { people: gap > 0, agents: gap < 0, equal: gap === 0 }[chosen("outcome")] ?? true;
    return (!chosen("split") || entry.row.dataset.split === chosen("split"))
      && (!chosen("scene") || entry.row.dataset.scene === chosen("scene"))
      && (!chosen("outcome") || (gap !== null && outcome))
      && this.has(entry, chosen("text").trim().toLowerCase());
  }

  show() {
    const passing = this.rows.filter((entry) => this.passes(entry));
    const visible = passing.slice(0, this.shown).map((entry) => entry.row);
    this.body.replaceChildren(...visible);
    const shown = visible.length < passing.length ? `${visible.length} shown of ` : "";
    this.status.textContent = `${shown}${passing.length} of ${this.rows.length} episodes`;
    this.more.hidden = visible.length === passing.length;
  }

  takeMeans(who) {
    for (const entry of this.rows) {
      const trials = [...entry.row.querySelectorAll("li[data-scored]")].filter(
        (trial) => trial.dataset.kind === "agent" && (!who || trial.dataset.name === who),
      );
      for (const cell of entry.row.querySelectorAll('td[data-key^="agents-"]')) {
        const name = cell.dataset.key.slice("agents-".length);
        const values = trials.map((trial) => trial.dataset[name]).filter((value) => value !== "").map(Number);
        this.write(entry, cell, mean(values));
      }
      for (const cell of entry.row.querySelectorAll('td[data-key^="difference-"]')) {
        const name = cell.dataset.key.slice("difference-".length);
        const [people, agents] = [entry.keys[`people-${name}`], entry.keys[`agents-${name}`]];
        this.write(entry, cell, people === null || agents === null ? null : people - agents);
      }
    }
    if (this.key) this.sortBy(this.key, this.isDown);
  }

  write(entry, cell, value) {
    const head = this.buttons.find((button) => button.dataset.key === cell.dataset.key);
    const isSigned = head.dataset.key.startsWith("difference-");
    entry.keys[cell.dataset.key] = value;
    cell.dataset.value = value ?? "";
    cell.textContent = written(value, { digits: Number(head.dataset.digits), isSigned });
    const isLead = head.dataset.key === "difference-sr"; // only a difference of success has a colour
    cell.classList.toggle("better-people", isLead && value > 0);
    cell.classList.toggle("better-agents", isLead && value < 0);
  }
}

function leadToViewer(link) {
  const path = link.getAttribute("href");
  if (isServed) {
    const address = encodeURIComponent(new URL(path, location.href).href);
    const viewer = document.documentElement.dataset.viewer ?? "/viewer/"; // a copy on a static host says its own
    link.href = `${viewer}?url=${address}&hide_welcome_screen=1&persist=0`;
    link.target = "_blank";
  } else {
    link.title = `Open with: rerun ${path}`;
  }
}

if (isServed) document.getElementById("how").textContent = "Each row has a contact sheet and a recording to replay.";
for (const section of document.querySelectorAll("section")) new Table(section);
