//! The photographs that were trained on, the one that is fitted worst first.

use crate::eval::{TrainingPhotograph, misfits};
use crate::format::markup::escape;

/// Rows that are shown; more unfold.
const SHOWN: usize = 10;

/// A table of the loss of each photograph, and why photographs were left out; nothing where nothing was trained.
pub(super) fn table(photographs: &[TrainingPhotograph]) -> String {
    if photographs.is_empty() {
        return String::new();
    }
    let (left_out, trained): (Vec<&TrainingPhotograph>, Vec<&TrainingPhotograph>) =
        photographs.iter().partition(|p| p.left_out.is_some());
    let worst = trained.iter().filter_map(|p| p.loss).fold(0.0, f64::max);
    let odd: Vec<&str> = misfits(photographs).into_iter().map(|p| p.name.as_str()).collect();
    let rows: Vec<String> = left_out
        .iter()
        .map(|p| row(p, worst, p.left_out.as_deref().unwrap_or_default()))
        .chain(trained.iter().map(|p| {
            let odd = odd.contains(&p.name.as_str());
            row(p, worst, if odd { "far above the others: look at its pose, and whether it is sharp" } else { "" })
        }))
        .collect();
    // What was left out, and what stands out, is always shown.
    let shown = SHOWN.max(left_out.len() + odd.len()).min(rows.len());
    let (first, rest) = rows.split_at(shown);
    let head = "<thead><tr><th scope=\"col\">Photograph</th><th scope=\"col\" class=\"number\">Loss</th>\
                <td class=\"bar\"></td><th scope=\"col\"></th></tr></thead>";
    let more = match rest.len() {
        0 => String::new(),
        n => format!(
            "<details><summary>{n} more</summary><table class=\"scores\">{head}<tbody>{}</tbody></table></details>",
            rest.concat()
        ),
    };
    format!(
        "<table class=\"scores\" id=\"training\"><caption>Each photograph trained on, the one that is fitted worst \
         first</caption>{head}<tbody>{}</tbody></table>{more}",
        first.concat()
    )
}

fn row(photograph: &TrainingPhotograph, worst: f64, remark: &str) -> String {
    let loss = photograph.loss.map_or_else(|| "\u{2013}".to_owned(), |loss| format!("{loss:.4}"));
    let share = photograph.loss.filter(|_| worst > 0.0).map_or(0.0, |loss| (100.0 * loss / worst).clamp(0.0, 100.0));
    let left_out = if photograph.left_out.is_some() { "left out: " } else { "" };
    format!(
        "<tr><th scope=\"row\">{}</th><td class=\"number\">{loss}</td><td class=\"bar\" aria-hidden=\"true\">\
         <span style=\"width:{share:.1}%\"></span></td><td>{left_out}{}</td></tr>",
        escape(&photograph.name),
        escape(remark)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn photograph(k: usize, loss: Option<f64>, left_out: Option<&str>) -> TrainingPhotograph {
        TrainingPhotograph { name: format!("<{k}>.jpg"), loss, steps: 4, left_out: left_out.map(str::to_owned) }
    }

    #[test]
    fn photographs_left_out_and_those_fitted_worst_come_first() {
        let mut all: Vec<TrainingPhotograph> =
            (0..40).map(|k| photograph(k, Some(0.06 - 0.001 * k as f64), None)).collect();
        all[0].loss = Some(0.4);
        all.push(photograph(99, None, Some("wrong pose")));
        let html = table(&all);
        let place = |text: &str| html.find(text).unwrap_or_else(|| panic!("{text} is not there: {html}"));
        assert!(place("&lt;99&gt;.jpg") < place("&lt;0&gt;.jpg") && place("&lt;0&gt;.jpg") < place("&lt;1&gt;.jpg"));
        assert!(place("left out: wrong pose") < place("far above the others") && html.contains(">0.4000<"));
        assert!(
            html.contains("31 more")
                && place("31 more") > place("&lt;8&gt;.jpg")
                && place("31 more") < place("&lt;9&gt;.jpg")
        );
        assert_eq!(html.matches("<tr><th scope=\"row\">").count(), 41);
        assert_eq!(table(&[]), "");
        assert!(table(&[photograph(0, None, None)]).contains('\u{2013}'));
    }
}
