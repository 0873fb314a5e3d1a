//! `uvcam doctor`: what is wrong on this machine, and the command that mends it.

use serde::Serialize;

use crate::args;
use crate::config::Config;
use crate::doctor::{self, Finding, Severity};
use crate::error::Error;
use crate::exit::Exit;

#[derive(Serialize)]
struct Report<'a> {
    healthy: bool,
    findings: &'a [Finding],
}

pub(super) fn execute(arguments: &args::Doctor, config: &Config) -> Result<Exit, Error> {
    let findings = doctor::examine(&arguments.root, config);
    let healthy = findings.iter().all(|finding| finding.severity < Severity::Fault);
    if arguments.json {
        let report = Report { healthy, findings: &findings };
        // A value of plain texts always has a JSON form.
        super::print(&serde_json::to_string_pretty(&report).unwrap_or_default())?;
    } else if findings.is_empty() {
        tracing::info!("nothing to mend for {} cameras", config.cameras.len());
    } else {
        super::print(&text(&findings))?;
    }
    Ok(if healthy { Exit::Done } else { Exit::Fault })
}

fn text(findings: &[Finding]) -> String {
    let line =
        |Finding { severity, finding, remedy, .. }: &Finding| format!("{severity}: {finding}\n    {remedy}");
    findings.iter().map(line).collect::<Vec<_>>().join("\n")
}
