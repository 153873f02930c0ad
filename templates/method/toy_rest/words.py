"""Words of the method in a report, and their translations.

Flags begin with the name of the method, because for equal names the words of shipped methods take precedence.
"""

UNITS = {
    "toy_rest_too_few_readings": "Too few readings at rest could be used; no drift is stated.",
}
REASONS = {
    "toy_rest_curved": "the readings follow a curve, not a line: the unit was still warming up",
}
CONDITIONS = {"over_h": "over {value} h"}

WORDS = {"UNITS": UNITS, "REASONS": REASONS, "CONDITIONS": CONDITIONS}

TRANSLATIONS = {
    "zh": {
        "Output and drift at rest": "静止输出与漂移试验",
        "rest mean": "静止输出均值",
        "rest drift": "静止漂移",
        "rest scatter": "静止读数分散",
        "mean output at rest": "静止时输出的均值",
        "slope of the output, relative to its mean": "输出的斜率（相对于均值）",
        "standard deviation of a reading about the line, relative": "单次读数相对于直线的标准差（相对值）",
        "scatter about the line": "相对于直线的分散",
        "resolution of each": "各次读数的分辨力",
        "few readings": "读数数量有限",
        "at rest": "静止",
        "over {value} h": "历时 {value} h",
        "Readings at rest": "静止读数",
        "Means of the acquisitions, and their residuals from the line.": "各次采集的均值及其与直线之差。",
        "Number": "序号",
        "Time": "时间",
        "Output": "输出",
        "Residual": "残差",
        "Output at rest, relative to its mean": "静止输出（相对于均值）",
        "output / mean - 1": "输出/均值 - 1",
        "time": "时间",
        "Points: readings. Line: least squares; its slope is the drift.": "点：读数。直线：最小二乘，斜率为漂移。",
        UNITS["toy_rest_too_few_readings"]: "可用的静止读数过少，不给出漂移。",
        REASONS["toy_rest_curved"]: "读数沿曲线变化而非直线：被测件仍在预热",
        (
            "The unit is measured together with its converter, at one attitude. The drift is that of both, with what "
            "the change of their temperature during the readings adds to it."
        ): "被测件与其转换器作为整体在一个位置上测量。漂移为两者之和，包含读数期间温度变化的影响。",
    }
}
