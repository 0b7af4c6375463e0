//! What commands do, as far as it matters to who corrects what they report.
//!
//! Place in the flow: [`super::Relay`] asks here before a command is passed on. A command that is not named here may do
//! anything: what it reports is not taken for anything known, and all that was known of the machine is asked for again.

/// What a command does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Does {
    /// Neither reports a position nor moves a coordinate system or the tip in its tool.
    Nothing,
    /// Opens a session.
    Start,
    /// Ends a session.
    End,
    /// Clears errors.
    Clear,
    /// Tells of errors.
    TellsErrors,
    /// Asks for the error state.
    TellsErrorState,
    /// Lets the operator move the machine and take points.
    EnablesUser,
    /// Reports what it asks for.
    Gets,
    /// Measures points; the last `OnPtMeasReport` says what is reported.
    Measures,
    /// Scans; the last `OnScanReport` says what is reported.
    Scans,
    /// Says what measured points report.
    SetsMeasured,
    /// Says what scans report.
    SetsScanned,
    /// Reports from now on while the machine moves.
    ReportsMoves,
    /// Stops one such report.
    StopsOne,
    /// Stops all of them.
    StopsAll,
    /// Moves the machine to a target.
    Moves,
    /// Sets properties.
    SetsProperties,
    /// Puts another tool into use.
    ChangesTool,
    /// Turns the tool.
    TurnsTool,
    /// Moves or selects a coordinate system.
    ChangesCsy,
    /// Not known here.
    Unknown,
}

/// What the command of this name does.
pub(super) fn does(name: &str) -> Does {
    match name {
        "StartSession" => Does::Start,
        "EndSession" => Does::End,
        "ClearAllErrors" => Does::Clear,
        "GetXtdErrStatus" => Does::TellsErrors,
        "GetErrStatusE" => Does::TellsErrorState,
        "EnableUser" => Does::EnablesUser,
        "Get" => Does::Gets,
        "PtMeas" | "PtMeasSelfCenter" | "PtMeasSelfCenterLocked" => Does::Measures,
        "ScanOnCircle"
        | "ScanOnLine"
        | "ScanOnCurve"
        | "ScanOnHelix"
        | "ScanInPlaneEndIsSphere"
        | "ScanInPlaneEndIsPlane"
        | "ScanInPlaneEndIsCyl"
        | "ScanInCylEndIsSphere"
        | "ScanInCylEndIsPlane" => Does::Scans,
        "OnPtMeasReport" => Does::SetsMeasured,
        "OnScanReport" => Does::SetsScanned,
        "OnMoveReport" | "OnMoveReportE" => Does::ReportsMoves,
        "StopDaemon" => Does::StopsOne,
        "StopAllDaemons" => Does::StopsAll,
        "GoTo" | "Step" | "GoToOnCircle" | "GoToOnSpiral" => Does::Moves,
        "SetProp" => Does::SetsProperties,
        "ChangeTool" | "SetTool" | "OpenToolCollection" => Does::ChangesTool,
        "AlignTool" | "ReQualify" => Does::TurnsTool,
        "SetCoordSystem"
        | "SetCsyTransformation"
        | "LoadCoordSystem"
        | "DeleteCoordSystem"
        | "AlignPart"
        | "EnableRotaryTableVarCsy"
        | "CenterPart"
        | "TiltPart"
        | "TiltCenterPart" => Does::ChangesCsy,
        name if HARMLESS.contains(&name) => Does::Nothing,
        _ => Does::Unknown,
    }
}

/// Commands that report no position and move nothing that a correction depends on.
const HARMLESS: [&str; 52] = [
    "AbortE",
    "AdvDataStruct",
    "CalcToolAlignment",
    "CalcToolAngles",
    "DisableOptimize",
    "DisableUser",
    "EnableOptimize",
    "EnumAllProp",
    "EnumAllToolCollections",
    "EnumCoordSystems",
    "EnumNameSpaces",
    "EnumProp",
    "EnumToolCollection",
    "EnumTools",
    "EnumerateMoverAxes",
    "FindTool",
    "FoundTool",
    "GetChangeToolAction",
    "GetCoordSystem",
    "GetCsyTransformation",
    "GetDMEVersion",
    "GetErrorInfo",
    "GetMachineClass",
    "GetNamedCsyTransformation",
    "GetProp",
    "GetPropE",
    "GetScaleTemperatures",
    "GetSupportedArguments",
    "GetSupportedCommands",
    "GetTemperatureSensors",
    "Home",
    "IsAlignable",
    "IsHomed",
    "IsOptimizeEnabled",
    "IsUserEnabled",
    "LockAxis",
    "LockPosition",
    "ReadAllTemperatures",
    "ReadTemperatureSensor",
    "SaveActiveCoordSystem",
    "SaveNamedCsyTransformation",
    "ScanOnCircleHint",
    "ScanOnCurveDensity",
    "ScanOnCurveHint",
    "ScanOnLineHint",
    "ScanUnknownDensity",
    "ScanUnknownHint",
    "SetScaleTemperatures",
    "SetTemperatureCompensationOrigin",
    "UpdateScaleTemperatures",
    "UseSmallestAngleToAlignTool",
    "UseSmallestAngletoAlignTool",
];

/// How many arguments a scan has, and where targets stand among them: the first of three numbers each. `None` where targets of
/// this command are not turned back.
pub(super) fn targets(name: &str) -> Option<(usize, &'static [usize])> {
    Some(match name {
        "ScanOnLine" => (10, &[0, 3]),
        "ScanOnCircle" => (12, &[0, 3]),
        "ScanInPlaneEndIsSphere" => (21, &[0, 9, 13]),
        "ScanInPlaneEndIsPlane" => (23, &[0, 9, 13]),
        "ScanInPlaneEndIsCyl" => (24, &[0, 9, 13]),
        "ScanInCylEndIsSphere" => (24, &[0, 6, 12, 16]),
        "ScanInCylEndIsPlane" => (26, &[0, 6, 12, 16]),
        _ => return None,
    })
}

/// Whether a command is answered before those that wait.
pub(super) fn is_fast(name: &str) -> bool {
    matches!(name, "AbortE" | "GetPropE" | "GetErrStatusE")
}

/// What may be asked of a server in an error state, and what ends that state.
pub(super) fn may_be_asked_in_error(does: Does, name: &str) -> bool {
    let ends = matches!(does, Does::Start | Does::End | Does::Clear | Does::StopsOne | Does::StopsAll);
    ends || matches!(does, Does::TellsErrors | Does::TellsErrorState) || name == "AbortE"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn harmless_commands_are_in_order_and_do_nothing_else() {
        assert!(HARMLESS.is_sorted());
        assert!(HARMLESS.iter().all(|name| does(name) == Does::Nothing));
        assert_eq!(does("CZ.Something"), Does::Unknown);
        assert_eq!(does("ptmeas"), Does::Unknown, "the protocol tells capitals apart");
    }
}
