"""How the report looks: one style sheet, light and dark, from a phone to a wide screen and paper."""

CSS = """
:root { color-scheme: light dark;
  --page:#fbfaf7; --ink:#1d1c1a; --soft:#6b6862; --line:#e2dfd7; --card:#ffffff;
  --accent:#b4541c; --warn:#9a3412; --warn-page:#fdf1e7; --lamp:#e0a020; --object:#2563a8; }
@media (prefers-color-scheme: dark) { :root {
  --page:#161513; --ink:#ece9e2; --soft:#a19c92; --line:#34312c; --card:#1f1d1a;
  --accent:#f0995b; --warn:#f8b48a; --warn-page:#33221a; --lamp:#f2c14e; --object:#7db4ee; } }
* { box-sizing: border-box; }
body { margin:0; background:var(--page); color:var(--ink);
  font:16px/1.55 system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",sans-serif; }
main { max-width:1080px; margin:0 auto; padding:3rem 1.25rem 5rem; }
h1 { font-size:2rem; line-height:1.15; letter-spacing:-.02em; margin:0 0 .25rem; overflow-wrap:anywhere; }
h2 { font-size:1.2rem; letter-spacing:-.01em; margin:3.25rem 0 .35rem; padding-top:1.1rem;
  border-top:1px solid var(--line); }
p { max-width:68ch; margin:.35rem 0 .9rem; }
.lead,.note,figcaption,.missing { color:var(--soft); }
.note { font-size:.9rem; }
.missing { border:1px dashed var(--line); border-radius:8px; padding:.9rem 1.1rem; }
.numbers { display:grid; grid-template-columns:repeat(auto-fit,minmax(150px,1fr)); gap:1px;
  margin:1.75rem 0 0; background:var(--line); border:1px solid var(--line); border-radius:10px;
  overflow:hidden; }
.numbers div { background:var(--card); padding:.85rem 1rem; }
.numbers b { display:block; font-size:1.35rem; font-weight:600; white-space:nowrap;
  font-variant-numeric:tabular-nums; }
.numbers span { font-size:.82rem; color:var(--soft); line-height:1.3; display:block; }
.grid { display:grid; gap:1.5rem 1.25rem; grid-template-columns:repeat(auto-fill,minmax(180px,1fr)); }
.pair { display:grid; gap:1.25rem; grid-template-columns:repeat(auto-fit,minmax(280px,1fr)); }
.triple { display:grid; gap:.4rem 1rem; grid-template-columns:repeat(3,1fr); margin-bottom:1.4rem; }
figure { margin:0; min-width:0; }
figure img, figure svg { width:100%; height:auto; display:block; border-radius:6px; }
figure img.map { image-rendering:pixelated; background:var(--card); border:1px solid var(--line); }
figcaption { font-size:.85rem; line-height:1.4; margin-top:.45rem; }
figcaption b { color:var(--ink); font-weight:600; }
.bar { display:grid; grid-template-columns:auto 1fr auto; gap:.5rem; align-items:center;
  margin-top:.45rem; font-size:.78rem; font-variant-numeric:tabular-nums; color:var(--soft); }
.bar img { height:9px; width:100%; border-radius:2px; image-rendering:auto; }
svg { background:var(--card); border:1px solid var(--line); }
svg .point { fill:var(--soft); opacity:.28; } svg .lamp { fill:var(--lamp); opacity:.5; }
svg .way { fill:none; stroke:var(--line); stroke-width:1; } svg .look { stroke:var(--accent);
  stroke-width:1; }
svg .camera { fill:var(--accent); } svg .object { fill:var(--object); }
svg .scale { stroke:var(--ink); stroke-width:2; } svg .scale-text { fill:var(--ink); font-size:12px; }
.key { display:inline-block; width:.65em; height:.65em; border-radius:50%; margin:0 .3em 0 .7em; }
.key:first-child { margin-left:0; }
.scroll { overflow-x:auto; }
table { border-collapse:collapse; font-size:.88rem; font-variant-numeric:tabular-nums;
  margin:.5rem 0 1rem; }
th,td { text-align:left; padding:.28rem 1.1rem .28rem 0; border-bottom:1px solid var(--line);
  vertical-align:top; }
th { font-weight:600; color:var(--soft); } td.n,th.n { text-align:right; white-space:nowrap; }
td { overflow-wrap:anywhere; }
.time { height:.7rem; background:var(--accent); border-radius:2px; min-width:2px; }
.verdict { padding:.7rem 1.1rem; margin:.8rem 0; border-left:4px solid var(--accent); }
.verdict.doubted { border-color:var(--warn); background:var(--warn-page); border-radius:8px; }
ul.care { padding:.8rem 1.1rem .8rem 2rem; margin:.8rem 0; background:var(--warn-page); border-radius:8px; }
ul.care li { margin:.2rem 0; } ul.care li::marker { color:var(--warn); }
details { margin:.35rem 0; } summary { cursor:pointer; font-weight:500; }
code { font:.88em ui-monospace,SFMono-Regular,Menlo,monospace; }
@media (max-width:560px) { main { padding:1.5rem .9rem 3rem; } h1 { font-size:1.5rem; }
  .grid { grid-template-columns:repeat(2,1fr); gap:1.1rem .7rem; } .triple { gap:.3rem .4rem; }
  .triple figcaption { font-size:.75rem; } }
@media print { main { max-width:none; padding:0; } figure,tr { break-inside:avoid; } }
"""
