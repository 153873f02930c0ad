// The editor of a sequence: CodeMirror in place of the text area, completion by the station, a check as one types.
// @ts-check

/**
 * @typedef {{ severity: "error" | "warning", rule: string, line: number, column: number, text: string }} Finding
 * @typedef {{ label: string, kind: string, info: string }} Option
 */

const DELAY_MS = 500;

const form = document.getElementById("editor");
const area = document.getElementById("text");
if (form instanceof HTMLFormElement && area instanceof HTMLTextAreaElement) void begin(form, area);

/** @param {HTMLFormElement} form @param {HTMLTextAreaElement} area */
async function begin(form, area) {
  const parts = await import(form.dataset.codemirror ?? "");
  const { EditorState, EditorView } = parts;
  const checked = /** @type {HTMLElement} */ (document.getElementById("checked"));
  let saving = false;
  const view = new EditorView({
    parent: area.parentElement,
    state: EditorState.create({
      doc: area.value,
      extensions: [
        EditorView.cspNonce.of(form.dataset.nonce ?? ""),
        EditorState.phrases.of(JSON.parse(form.dataset.phrases ?? "{}")),
        EditorView.contentAttributes.of({ tabindex: "0", "aria-labelledby": "text-label", spellcheck: "false" }),
        parts.lineNumbers(),
        parts.foldGutter(),
        parts.lintGutter(),
        parts.history(),
        parts.highlightSpecialChars(),
        parts.highlightActiveLine(),
        parts.bracketMatching(),
        parts.indentUnit.of("  "),
        parts.yaml(),
        parts.syntaxHighlighting(parts.classHighlighter),
        parts.autocompletion({ override: [(/** @type {any} */ context) => options(form, context)] }),
        parts.linter((/** @type {any} */ view) => check(form, view, checked), { delay: DELAY_MS }),
        parts.keymap.of([...parts.completionKeymap, ...parts.lintKeymap, ...parts.foldKeymap, ...parts.historyKeymap, ...parts.defaultKeymap]),
        EditorView.updateListener.of((/** @type {any} */ update) => {
          if (!update.docChanged) return;
          area.value = update.state.doc.toString();
          checked.classList.add("is-old");
        }),
      ],
    }),
  });
  const before = area.defaultValue;
  area.hidden = true;
  document.getElementById("keys")?.removeAttribute("hidden");
  document.getElementById("text-label")?.addEventListener("click", () => view.focus());
  document.getElementById("bench")?.addEventListener("change", () => void check(form, view, checked));
  checked.addEventListener("click", (event) => {
    const line = event.target instanceof HTMLElement ? event.target.dataset.line : undefined;
    if (line === undefined) return;
    event.preventDefault();
    const at = view.state.doc.line(Math.min(Number(line), view.state.doc.lines)).from;
    view.dispatch({ selection: { anchor: at }, effects: EditorView.scrollIntoView(at, { y: "center" }) });
    view.focus();
  });
  form.addEventListener("submit", () => {
    area.value = view.state.doc.toString();
    saving = true;
  });
  addEventListener("beforeunload", (event) => {
    if (!saving && area.value !== before) event.preventDefault();
  });
}

/**
 * Findings at their places; the part of the page beside the text shows them in words.
 * @param {HTMLFormElement} form @param {any} view @param {HTMLElement} checked
 */
async function check(form, view, checked) {
  const text = view.state.doc.toString();
  const fields = new FormData(form);
  fields.set("text", text);
  const sent = new URLSearchParams(/** @type {[string, string][]} */ ([...fields]));
  const answer = await fetch(form.dataset.check ?? "", { method: "POST", body: sent }).catch(() => null);
  if (answer === null || !answer.ok || view.state.doc.toString() !== text) return [];
  /** @type {{ found: Finding[], html: string }} */
  const content = await answer.json();
  checked.innerHTML = content.html;
  checked.classList.remove("is-old");
  return content.found.map((each) => {
    const line = view.state.doc.line(Math.min(each.line, view.state.doc.lines));
    const from = Math.min(line.from + each.column - 1, line.to);
    return { from, to: Math.max(from, line.to), severity: each.severity, message: each.text };
  });
}

/**
 * What may stand at the cursor. The station counts whole characters, the editor halves of them.
 * @param {HTMLFormElement} form @param {any} context
 */
async function options(form, context) {
  const word = context.matchBefore(/[A-Za-z_][\w/]*/);
  const follows = /(^|[\s{[,:]|\$\{)$/.test(context.state.sliceDoc(Math.max(0, context.pos - 2), context.pos));
  if (!context.explicit && word === null && !follows) return null;
  const text = context.state.doc.toString();
  const at = [...text.slice(0, context.pos)].length;
  const bench = new FormData(form).get("bench");
  const answer = await fetch("/api/v1/completion", {
    method: "POST",
    headers: { "content-type": "application/json" },
    body: JSON.stringify({ text, bench, at }),
  }).catch(() => null);
  if (answer === null || !answer.ok) return null;
  /** @type {{ start: number, options: Option[] }} */
  const found = await answer.json();
  if (found.options.length === 0) return null;
  return {
    from: context.pos - (at - found.start),
    validFor: /^[\w/]*$/,
    options: found.options.map((each, number) => ({
      label: each.label,
      detail: each.kind === "key" ? undefined : each.info,
      info: each.kind === "key" && each.info ? each.info : undefined,
      apply: each.kind === "key" && !followedByColon(context) ? `${each.label}: ` : each.label,
      boost: -number / 10,
    })),
  };
}

/** @param {any} context */
function followedByColon(context) {
  return /^[\w/]*:/.test(context.state.sliceDoc(context.pos, context.pos + 64));
}
