//! The 3-D view of a page in a headless Chromium. Each test is also made on a page that was broken, and must fail there.

use super::{N_ARRAYS, arrays, mesh, skipped, write, write_on};
use eplat::mesh::{Axes, TriMesh};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::Command;

const WEBGL: &[&str] = &["--use-angle=swiftshader", "--enable-unsafe-swiftshader"];
pub(super) const FLAT: &[&str] = &["--disable-3d-apis"];
const DARK: &[&str] = &["--disable-3d-apis", "--blink-settings=preferredColorScheme=0"];

/// The page after its scripts ran, as Chromium has it, or none without Chromium.
fn rendered(path: &Path, flags: &[&str]) -> Option<String> {
    let named = std::env::var_os("EPLAT_CHROMIUM").map(PathBuf::from);
    let profile = tempfile::tempdir().unwrap();
    let output = Command::new(named.unwrap_or("chromium".into()))
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-background-networking",
            "--virtual-time-budget=30000",
        ])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .args(flags)
        .arg("--dump-dom")
        .arg(path)
        .output();
    let Ok(output) = output else {
        skipped::skipped("no Chromium found (EPLAT_CHROMIUM)");
        return None;
    };
    Some(String::from_utf8(output.stdout).unwrap())
}

/// What `body` returns when it is run in the page (see `probe.js`), or none without Chromium.
pub(super) fn told(html: &str, body: &str, flags: &[&str]) -> Option<Value> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("report.html");
    let probed = html.replace("</body>", &format!("<script>{}</script></body>", probe(body)));
    std::fs::write(&path, probed).unwrap();
    let dom = rendered(&path, flags)?;
    Some(read(&dom))
}

/// The same where the page is in a frame of this width: Chromium has no window below 500 px.
fn told_in_frame(html: &str, body: &str, width: usize) -> Option<Value> {
    let folder = tempfile::tempdir().unwrap();
    let inner = html.replace("</body>", &format!("<script>{}</script></body>", probe(body)));
    std::fs::write(folder.path().join("inner.html"), inner).unwrap();
    let outer = format!(
        "<iframe src=\"inner.html\" style=\"width: {width}px; height: 844px\" frameborder=\"0\"></iframe>
         <script>onmessage = ({{ data }}) => {{
           const out = document.createElement('script');
           [out.type, out.id, out.textContent] = ['application/json', 'told', data];
           document.body.append(out);
         }}</script>"
    );
    let path = folder.path().join("outer.html");
    std::fs::write(&path, outer).unwrap();
    Some(read(&rendered(&path, FLAT)?))
}

fn probe(body: &str) -> String {
    include_str!("probe.js").replace("BODY", body)
}

fn read(dom: &str) -> Value {
    let told = dom.split_once("id=\"told\">").and_then(|(_, rest)| rest.split_once("</script>"));
    let failed =
        || dom.split_once("data-failed").map_or("", |(_, rest)| &rest[..rest.len().min(500)]);
    let (told, _) = told.unwrap_or_else(|| panic!("the probe did not end: {}", failed()));
    serde_json::from_str(told).unwrap()
}

/// The page with its script or style changed at the one place that reads `from`.
pub(super) fn broken(html: &str, from: &str, to: &str) -> String {
    assert_eq!(html.matches(from).count(), 1, "{from}");
    html.replace(from, to)
}

pub(super) fn html_on(mesh: &TriMesh, axes: Axes, arrays: &[(String, Vec<f64>)]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("report.html");
    write_on(mesh, axes, &path, "Erp", arrays, 20).unwrap();
    std::fs::read_to_string(&path).unwrap()
}

fn html() -> String {
    html_on(&mesh(), Axes::Unknown, &arrays(&mesh()))
}

fn number(told: &Value, name: &str) -> f64 {
    told[name].as_f64().unwrap_or_else(|| panic!("no number {name} in {told}"))
}

#[test]
fn a_browser_draws_the_fields_with_and_without_webgl() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("report.html");
    write(&path, "Erp", &arrays(&mesh())).unwrap();
    let (Some(with), Some(without)) = (rendered(&path, WEBGL), rendered(&path, FLAT)) else {
        return;
    };
    // two lists of fields, "nothing" and the two sides of a threshold
    for dom in [&with, &without] {
        assert_eq!(dom.matches("<option").count(), 2 * N_ARRAYS + 3, "the viewer did not start");
        assert!(dom.contains("<canvas") && dom.contains("Grey: no value."), "nothing was drawn");
    }
    assert!(with.contains("data-engine=\"three.js") && with.contains("Drag to turn"), "no WebGL");
    assert!(without.contains("drawn without it, more slowly"), "the fallback did not start");
    assert!(with.contains("10 measurement sites"), "no count of the sites");
    let damaged = broken(&std::fs::read_to_string(&path).unwrap(), "\"walk\":\"", "\"walk\":\"!");
    std::fs::write(&path, damaged).unwrap();
    let dom = rendered(&path, FLAT).unwrap();
    assert!(dom.contains("role=\"alert\">The maps cannot be shown: "), "trouble is not told");
}

#[test]
fn no_column_is_clipped_at_ordinary_widths() {
    let body = "const edge = document.documentElement.clientWidth;
      const beyond = all('main *').filter((e) => !e.closest('pre'))
        .filter((e) => e.getBoundingClientRect().width && e.getBoundingClientRect().right > edge);
      return beyond.map((e) => e.tagName).join(' ');";
    for width in [1280, 1024, 800] {
        let size = format!("--window-size={width},900");
        let Some(told) = told(&html(), body, &[FLAT, &[&size]].concat()) else { return };
        assert_eq!(told, "", "{width} px");
    }
}

#[test]
fn the_view_stays_turned_when_another_field_is_shown() {
    let body = "const home = await outline(0);
      for (const key of ['ArrowLeft', 'ArrowLeft', 'ArrowLeft', 'ArrowUp', 'ArrowUp']) press(key);
      const turned = await outline(0);
      choose('#quantity', 'apd_max_mean [ms]');
      await wait(100);
      return { title: one('.pane figcaption').textContent,
        turned: differ(home, turned), kept: differ(turned, await outline(0)) };";
    let html = html();
    for flags in [WEBGL, FLAT] {
        let Some(told) = told(&html, body, flags) else { return };
        assert_eq!(told["title"], "apd_max_mean [ms]");
        assert!(number(&told, "turned") > 0.02 && number(&told, "kept") == 0.0, "{told}");
    }
    let twin = broken(&html, "fitThreshold(first);", "fitThreshold(first); view.reset();");
    let told = told(&twin, body, FLAT).unwrap();
    assert!(number(&told, "kept") > 0.02, "{told}");
}

#[test]
fn two_fields_turn_together_and_share_a_scale_if_they_compare() {
    let body = "choose('#beside', 'tau_out_true [ms]');
      await wait(100);
      const home = await outline(1);
      for (const key of ['ArrowLeft', 'ArrowLeft', 'ArrowLeft', 'ArrowUp', 'ArrowUp']) press(key, 1);
      const [left, right] = [await outline(0), await outline(1)];
      const ticks = () => all('.pane .ticks').map((list) => list.textContent);
      const shared = ticks();
      choose('#beside', 'apd_max_mean [ms]');
      const other = ticks();
      const boxes = all('.pane').map((pane) => pane.getBoundingClientRect());
      choose('#beside', 'nothing');
      return { turned: differ(home, right), apart: differ(left, right), shared: shared[0] === shared[1],
        other: other[0] === other[1], level: boxes[0].top === boxes[1].top && boxes[0].right < boxes[1].left,
        hidden: all('.pane')[1].hidden };";
    let html = html();
    let expected = json!({"shared": true, "other": false, "level": true, "hidden": true});
    for flags in [WEBGL, FLAT] {
        let Some(told) = told(&html, body, flags) else { return };
        assert!(number(&told, "turned") > 0.02 && number(&told, "apart") == 0.0, "{told}");
        for (name, value) in expected.as_object().unwrap() {
            assert_eq!(&told[name], value, "{name} of {told}");
        }
    }
    let own = "surface, shape, panes.length ? newCamera(surface, () => {}) : view);";
    let twin = broken(&html, "surface, shape, view);", own);
    let apart = told(&twin, body, WEBGL).unwrap();
    assert!(number(&apart, "apart") > 0.02, "{apart}");
    let twin =
        broken(&html, "return a === b || areBoth &&", "return a === b || false && areBoth &&");
    assert_eq!(told(&twin, body, FLAT).unwrap()["shared"], false);
}

/// A plate of 36 × 20 mm whose columns become wider, with x as its field: what lies at or above x = t is
/// (36 − t) / 36 of its area, and another share of its triangles.
fn plate() -> (TriMesh, Vec<(String, Vec<f64>)>) {
    let columns = [0.0, 1.0, 3.0, 6.0, 10.0, 15.0, 21.0, 28.0, 36.0];
    let vertices: Vec<[f64; 3]> =
        (0..5).flat_map(|row| columns.map(|x| [x, 5.0 * f64::from(row), 0.0])).collect();
    let at = |row: u32, column: u32| 9 * row + column;
    let squares = (0..4).flat_map(|row| (0..8).map(move |column| (row, column)));
    let triangles = squares.flat_map(|(r, c)| {
        let [a, b, d, e] = [at(r, c), at(r, c + 1), at(r + 1, c), at(r + 1, c + 1)];
        [[a, b, d], [b, e, d]]
    });
    let x: Vec<f64> = vertices.iter().map(|at| at[0]).collect();
    let part = x.iter().map(|&x| if x > 15.0 { f64::NAN } else { x }).collect();
    let mesh = TriMesh::new(vertices, triangles.collect()).unwrap();
    (mesh, vec![("lat".into(), x), ("part".into(), part)])
}

#[test]
fn a_threshold_greys_one_side_and_tells_the_share_of_the_area() {
    let body = "const grey = async () => {
        const seen = (await picture(0)).filter(([, , , alpha]) => alpha > 127);
        return seen.filter(([r, g, b]) => Math.max(r, g, b) - Math.min(r, g, b) < 40).length / seen.length;
      };
      const share = () => one('.share').textContent;
      const off = [one('#threshold').checked, one('#threshold-settings').hidden, share(), await grey() < 0.01];
      one('#sites').click();
      press('z');
      one('#threshold').click();
      enter('#threshold-number', '27');
      const typed = share(), below = await grey();
      choose('#fades', 'at or above it');
      const above = await grey();
      enter('#threshold-slider', '250');
      const slid = [share(), one('#threshold-number').value, one('#threshold-slider').ariaValueText];
      choose('#quantity', 'part [ms]');
      return { off, typed, below, above, slid, part: share() };";
    let (mesh, arrays) = plate();
    let html = html_on(&mesh, Axes::Unknown, &arrays);
    for flags in [WEBGL, FLAT] {
        let Some(told) = told(&html, body, flags) else { return };
        assert_eq!(told["off"], json!([false, true, "", true]));
        assert_eq!(told["typed"], "25.0 % of the area is at or above 27 ms.");
        assert!((number(&told, "below") - 0.75).abs() < 0.02, "{told}");
        assert!((number(&told, "above") - 0.25).abs() < 0.02, "{told}");
        let slid = "75.0 % of the area is at or above 9 ms.";
        assert_eq!(told["slid"], json!([slid, "9", "9 ms"]));
        let part =
            "50.0 % of the area that has values (41.7 % of the surface) is at or above 7.5 ms.";
        assert_eq!(told["part"], part);
    }
    let twin = broken(&html, "all += area;", "area = 1; all += area;");
    let told = told(&twin, body, FLAT).unwrap();
    assert_ne!(told["typed"], "25.0 % of the area is at or above 27 ms.");
}

#[test]
fn keys_turn_zoom_and_look_from_named_sides() {
    let body = "const look = async (key) => { press(key); await picture(0); return one('.seen').textContent; };
      const home = await outline(0);
      for (let i = 0; i < 6; i++) press('ArrowLeft');
      const turned = await outline(0);
      press('+'); press('+');
      const near = await outline(0);
      press('-'); press('-'); press('-'); press('-');
      const far = await outline(0);
      press('Home');
      const again = await outline(0);
      const sides = [];
      for (const key of KEYS) sides.push(await look(key));
      one('.stage').focus({ focusVisible: true });
      const { outlineStyle, outlineWidth } = getComputedStyle(one('.stage'));
      const buttons = all('#standard button');
      buttons[1].click();
      await picture(0);
      return { turned: differ(home, turned), again: differ(home, again), sides, clicked: one('.seen').textContent,
        sizes: [near, turned, far].map(covered), buttons: buttons.map((b) => b.textContent).join(' '),
        labels: buttons.every((b) => b.ariaLabel) && !!one('.stage').ariaLabel, tab: one('.stage').tabIndex,
        alternative: one('.stage canvas').ariaLabel, focus: `${outlineStyle} ${outlineWidth}` };";
    let of = |keys: &str| body.replace("KEYS", &format!("[...'{keys}']"));
    let html = html();
    let Some(by_axes) = told(&html, &of("xXyYzZ"), WEBGL) else { return };
    let sides = ["from +x", "from −x", "from +y", "from −y", "from +z", "from −z"];
    assert_eq!(by_axes["sides"], json!(sides));
    assert_eq!(by_axes["clicked"], "from −x");
    assert_eq!(by_axes["buttons"], "+x −x +y −y +z −z reset");
    assert!(number(&by_axes, "turned") > 0.02 && number(&by_axes, "again") == 0.0, "{by_axes}");
    let sizes: Vec<f64> = (0..3).map(|i| by_axes["sizes"][i].as_f64().unwrap()).collect();
    assert!(sizes[0] > 1.1 * sizes[1] && sizes[1] > 1.1 * sizes[2], "{sizes:?}");
    assert_eq!((&by_axes["labels"], &by_axes["tab"]), (&json!(true), &json!(0)));
    assert_eq!(by_axes["focus"], "solid 3px");
    let alternative = by_axes["alternative"].as_str().unwrap();
    assert!(
        alternative.starts_with("tau_out_mean [ms] on the surface, seen from −x. min "),
        "{alternative}"
    );

    let patient = html_on(&mesh(), Axes::Patient, &arrays(&mesh()));
    let by_body = told(&patient, &of("APLRSI"), FLAT).unwrap();
    let sides = ["the front", "the back", "the left", "the right", "above", "below"];
    assert_eq!(by_body["sides"], json!(sides.map(|side| format!("from {side}"))));
    assert_eq!(by_body["buttons"], "A P L R S I reset");

    for (key, name) in
        [("ArrowLeft: () => turn(-step, 0)", "turned"), ("0: reset, Home: reset", "again")]
    {
        let (event, _) = key.split_once(':').unwrap();
        let twin =
            told(&broken(&html, key, &format!("{event}: () => {{}}")), &of("x"), WEBGL).unwrap();
        assert_ne!(number(&twin, name) > 0.02, number(&by_axes, name) > 0.02, "{twin}");
    }
}

#[test]
fn nothing_reaches_beyond_a_phone_and_views_lie_one_above_the_other() {
    let body = "choose('#beside', 'tau_out_true [ms]');
      await wait(100);
      const [first, second] = all('.pane').map((pane) => pane.getBoundingClientRect());
      const stage = one('.stage').getBoundingClientRect();
      return { width: innerWidth, beyond: document.documentElement.scrollWidth - document.documentElement.clientWidth,
        above: first.left === second.left && first.bottom <= second.top, low: stage.height < 400,
        touch: getComputedStyle(one('.stage canvas')).touchAction };";
    let html = html();
    let Some(phone) = told_in_frame(&html, body, 390) else { return };
    let expected = json!({"width": 390, "beyond": 0, "above": true, "low": true, "touch": "pan-y"});
    assert_eq!(phone, expected);
    let twin = broken(&html, "screen and (max-width: 760px)", "screen and (max-width: 76px)");
    let wide = told_in_frame(&twin, body, 390).unwrap();
    assert!(number(&wide, "beyond") > 0.0 && wide["above"] == false, "{wide}");
}

#[test]
fn text_and_curves_stand_out_in_the_dark_and_in_the_light() {
    let body = include_str!("contrast.js");
    let html = html();
    for (flags, is_dark) in [(FLAT, false), (DARK, true)] {
        let Some(told) = told(&html, body, flags) else { return };
        assert_eq!(number(&told, "page") < 0.1, is_dark, "{told}");
        assert!(number(&told, "checked") > 100.0, "{told}");
        assert_eq!(told["faint"], json!([]));
    }
    let twin = broken(&html, "--ink: #e4e8ed", "--ink: #4a5058");
    assert_ne!(told(&twin, body, DARK).unwrap()["faint"], json!([]));
}
