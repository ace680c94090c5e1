<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="zh_CN" sourcelanguage="en_US">
<context>
    <name>About</name>
    <message>
        <source>Free software under the Apache License 2.0.</source>
        <translation>自由软件，采用 Apache 许可证 2.0。</translation>
    </message>
    <message>
        <source>Calibration of multi-camera measuring rigs with an imperfect ball.</source>
        <translation>用非理想的球标定多相机测量系统。</translation>
    </message>
    <message>
        <source>About SphereCal</source>
        <translation>关于 SphereCal</translation>
    </message>
</context>
<context>
    <name>BallTab</name>
    <message>
        <source>Name of the ball</source>
        <translation>球的名称</translation>
    </message>
    <message>
        <source>such as Ball hall 3</source>
        <translation>例如 3 号厅的球</translation>
    </message>
    <message>
        <source>Diameter (mm)</source>
        <translation>直径 (mm)</translation>
    </message>
    <message>
        <source>A centimetre is near enough.</source>
        <translation>精确到一厘米即可。</translation>
    </message>
    <message>
        <source>First target, no.</source>
        <translation>首个靶标编号</translation>
    </message>
    <message>
        <source>Last target, no.</source>
        <translation>末个靶标编号</translation>
    </message>
    <message>
        <source>Width of a sticker (mm)</source>
        <translation>靶标贴纸宽度 (mm)</translation>
    </message>
    <message>
        <source>Measured on a sticker (mm)</source>
        <translation>在贴纸上量得 (mm)</translation>
    </message>
    <message>
        <source>Printed scale</source>
        <translation>打印比例</translation>
    </message>
    <message>
        <source>Without a bar that gives the scale, this distance does, good to a percent.</source>
        <translation>没有给出比例尺的基准尺时，由这一距离给出比例尺，准确到百分之一。</translation>
    </message>
    <message>
        <source>Ball of the library</source>
        <translation>库中的球</translation>
    </message>
    <message>
        <source>Which ball?</source>
        <translation>哪个球？</translation>
    </message>
    <message>
        <source>Targets from a file</source>
        <translation>从文件读取靶标</translation>
    </message>
    <message>
        <source>By number and width</source>
        <translation>按编号和宽度</translation>
    </message>
    <message>
        <source>Target set</source>
        <translation>靶标集</translation>
    </message>
    <message>
        <source>a new ball</source>
        <translation>新的球</translation>
    </message>
</context>
<context>
    <name>Banner</name>
    <message>
        <source>Close this message</source>
        <translation>关闭此消息</translation>
    </message>
</context>
<context>
    <name>Bars</name>
    <message>
        <source>Turn bar {bar} by {deg:.0f}°: from near {first} to near {last}</source>
        <translation>将基准尺 {bar} 转动 {deg:.0f}°：从 {first} 附近到 {last} 附近</translation>
    </message>
    <message>
        <source>It is in place. Wait until it is at rest</source>
        <translation>位置正确。请让它静止</translation>
    </message>
    <message>
        <source>Ready: press space</source>
        <translation>就绪：请按空格键</translation>
    </message>
    <message>
        <source>Lay bar {bar} as in the picture, near {first}</source>
        <translation>按图放置基准尺 {bar}，靠近 {first}</translation>
    </message>
    <message>
        <source>Lay bar {bar} as in the picture: from near {first} to near {last}</source>
        <translation>按图放置基准尺 {bar}：从 {first} 附近到 {last} 附近</translation>
    </message>
    <message>
        <source>Move bar {bar} {mm:.0f} mm up</source>
        <translation>将基准尺 {bar} 上移 {mm:.0f} mm</translation>
    </message>
    <message>
        <source>Move bar {bar} {mm:.0f} mm down</source>
        <translation>将基准尺 {bar} 下移 {mm:.0f} mm</translation>
    </message>
    <message>
        <source>Move bar {bar} {mm:.0f} mm towards {camera}</source>
        <translation>将基准尺 {bar} 向 {camera} 移动 {mm:.0f} mm</translation>
    </message>
    <message>
        <source>Pose {number} of {count}</source>
        <translation>姿态 {number}/{count}</translation>
    </message>
</context>
<context>
    <name>BarsTab</name>
    <message>
        <source>Bars of this computer</source>
        <translation>本机的基准尺</translation>
    </message>
    <message>
        <source>New bar</source>
        <translation>新基准尺</translation>
    </message>
    <message>
        <source>Remove</source>
        <translation>移除</translation>
    </message>
    <message>
        <source>Import CSV</source>
        <translation>导入 CSV</translation>
    </message>
    <message>
        <source>Export CSV</source>
        <translation>导出 CSV</translation>
    </message>
    <message>
        <source>2026-11-21</source>
        <translation>2026-11-21</translation>
    </message>
    <message>
        <source>Serial number</source>
        <translation>序列号</translation>
    </message>
    <message>
        <source>Description</source>
        <translation>说明</translation>
    </message>
    <message>
        <source>Expansion (10⁻⁶/K)</source>
        <translation>膨胀系数 (10⁻⁶/K)</translation>
    </message>
    <message>
        <source>Steel 11.5, aluminium 23, carbon fibre about 0.</source>
        <translation>钢 11.5，铝 23，碳纤维约 0。</translation>
    </message>
    <message>
        <source>Lengths are valid at (°C)</source>
        <translation>长度对应温度 (°C)</translation>
    </message>
    <message>
        <source>Certificate, no.</source>
        <translation>证书编号</translation>
    </message>
    <message>
        <source>Laboratory</source>
        <translation>实验室</translation>
    </message>
    <message>
        <source>Calibrated on</source>
        <translation>校准日期</translation>
    </message>
    <message>
        <source>Valid until</source>
        <translation>有效期至</translation>
    </message>
    <message>
        <source>On this bench</source>
        <translation>在此器具中</translation>
    </message>
    <message>
        <source>is not here</source>
        <translation>未使用</translation>
    </message>
    <message>
        <source>gives the scale</source>
        <translation>给出比例尺</translation>
    </message>
    <message>
        <source>verifies</source>
        <translation>用于检验</translation>
    </message>
    <message>
        <source>Certified lengths (mm)</source>
        <translation>证书长度 (mm)</translation>
    </message>
    <message>
        <source>Add a length</source>
        <translation>再加一个长度</translation>
    </message>
    <message>
        <source>Certificate and material</source>
        <translation>证书与材料</translation>
    </message>
    <message>
        <source>A table of bars</source>
        <translation>基准尺表格</translation>
    </message>
    <message>
        <source>The table is in {file}.</source>
        <translation>表格已写入 {file}。</translation>
    </message>
    <message>
        <source>new bar</source>
        <translation>新基准尺</translation>
    </message>
    <message>
        <source>something is missing</source>
        <translation>尚不完整</translation>
    </message>
    <message>
        <source>Remove this length</source>
        <translation>移除此长度</translation>
    </message>
</context>
<context>
    <name>Bench</name>
    <message>
        <source>Must be from {low} to {high}.</source>
        <translation>必须在 {low} 到 {high} 之间。</translation>
    </message>
    <message>
        <source>The certificate&apos;s number is missing.</source>
        <translation>缺少证书编号。</translation>
    </message>
    <message>
        <source>At least one certified length is needed.</source>
        <translation>至少需要一个证书长度。</translation>
    </message>
    <message>
        <source>The number printed at the sticker, such as 201.</source>
        <translation>贴纸上印的编号，例如 201。</translation>
    </message>
    <message>
        <source>The length on the certificate, in mm.</source>
        <translation>证书上的长度，单位 mm。</translation>
    </message>
    <message>
        <source>{count} targets, nos. {first}-{last}, {width} mm</source>
        <translation>{count} 个靶标，编号 {first}-{last}，{width} mm</translation>
    </message>
    <message>
        <source>A whole number, as printed at the stickers.</source>
        <translation>整数，如贴纸上所印。</translation>
    </message>
    <message>
        <source>A name by which you know the ball.</source>
        <translation>用于辨认此球的名称。</translation>
    </message>
    <message>
        <source>Measure it with a tape: a centimetre is near enough.</source>
        <translation>用卷尺量：精确到一厘米即可。</translation>
    </message>
    <message>
        <source>{first} and {second} are {mm:.2f} mm apart as designed: measure these two, in mm.</source>
        <translation>{first} 与 {second} 的设计间距为 {mm:.2f} mm：请量这两点，单位 mm。</translation>
    </message>
    <message>
        <source>Measure from dot {first} to dot {second} of a sticker with a caliper: {mm:.2f} mm as designed.</source>
        <translation>用卡尺量一张贴纸上从点 {first} 到点 {second} 的距离：设计值 {mm:.2f} mm。</translation>
    </message>
    <message>
        <source>Printed {percent:.2f} % too large.</source>
        <translation>打印偏大 {percent:.2f} %。</translation>
    </message>
    <message>
        <source>Printed {percent:.2f} % too small.</source>
        <translation>打印偏小 {percent:.2f} %。</translation>
    </message>
    <message>
        <source>Printers err by 0.5 % at most: this is as usual.</source>
        <translation>打印机误差最多 0.5 %：此值正常。</translation>
    </message>
    <message>
        <source>More than printers err: print at 100 %, without fitting to the page, or give the width as printed.</source>
        <translation>超出打印机的误差：请按 100 % 打印，不要适合页面，或填写实际打印的宽度。</translation>
    </message>
    <message>
        <source>From {low} to {high} placements of the ball.</source>
        <translation>球的摆放次数为 {low} 到 {high}。</translation>
    </message>
    <message>
        <source>Another bar has this serial number.</source>
        <translation>另一根基准尺已有此序列号。</translation>
    </message>
    <message>
        <source>Only one bar gives the scale; {bar} does already.</source>
        <translation>只能有一根基准尺给出比例尺；{bar} 已给出。</translation>
    </message>
    <message>
        <source>Sticker {number} is none of the ball&apos;s target set ({targets}).</source>
        <translation>贴纸 {number} 不属于球的靶标集（{targets}）。</translation>
    </message>
    <message>
        <source>Sticker {number} is on bar {bar} as well.</source>
        <translation>贴纸 {number} 也在基准尺 {bar} 上。</translation>
    </message>
    <message>
        <source>Nothing gives the scale: lengths will be arbitrary.</source>
        <translation>没有任何器具给出比例尺：长度将是任意的。</translation>
    </message>
    <message>
        <source>No bar verifies: the calibration cannot be verified.</source>
        <translation>没有用于检验的基准尺：无法验证标定。</translation>
    </message>
    <message>
        <source>Ball {mm} mm</source>
        <translation>球 {mm} mm</translation>
    </message>
    <message>
        <source>incomplete</source>
        <translation>尚不完整</translation>
    </message>
    <message>
        <source>Bars taken over: {count}.</source>
        <translation>已导入的基准尺：{count}。</translation>
    </message>
    <message>
        <source>With other figures than the library&apos;s, which can be undone: {bars}.</source>
        <translation>数值与库中不同（可撤销）：{bars}。</translation>
    </message>
    <message>
        <source>Lines that could not be used: {count}.</source>
        <translation>无法使用的行：{count}。</translation>
    </message>
    <message>
        <source>It holds for the real rig, not for this training.</source>
        <translation>适用于真实系统，不适用于本次练习。</translation>
    </message>
    <message>
        <source>It applies to the next calibration: this one already has images.</source>
        <translation>从下一次标定起生效：本次标定已有图像。</translation>
    </message>
    <message>
        <source>It holds for this calibration and the next ones.</source>
        <translation>适用于本次及以后的标定。</translation>
    </message>
    <message>
        <source>It applies to the next calibrations of this rig.</source>
        <translation>适用于本系统以后的标定。</translation>
    </message>
</context>
<context>
    <name>BenchDialog</name>
    <message>
        <source>The bench: ball, bars, limits</source>
        <translation>器具：球、基准尺、限值</translation>
    </message>
    <message>
        <source>Ball</source>
        <translation>球</translation>
    </message>
    <message>
        <source>Bars</source>
        <translation>基准尺</translation>
    </message>
    <message>
        <source>Placements and limits</source>
        <translation>摆放与限值</translation>
    </message>
    <message>
        <source>Undo</source>
        <translation>撤销</translation>
    </message>
    <message>
        <source>Redo</source>
        <translation>重做</translation>
    </message>
    <message>
        <source>Save</source>
        <translation>保存</translation>
    </message>
    <message>
        <source>Close</source>
        <translation>关闭</translation>
    </message>
    <message>
        <source>Nothing was changed.</source>
        <translation>没有更改。</translation>
    </message>
    <message>
        <source>Nothing was undone.</source>
        <translation>没有撤销任何操作。</translation>
    </message>
    <message>
        <source>To be corrected before saving: {count}</source>
        <translation>保存前需更正：{count}</translation>
    </message>
    <message>
        <source>No ball is described: only the library of bars is saved.</source>
        <translation>未描述球：只保存基准尺库。</translation>
    </message>
    <message>
        <source>Close without saving</source>
        <translation>不保存并关闭</translation>
    </message>
    <message>
        <source>and {count} more</source>
        <translation>另有 {count} 条</translation>
    </message>
    <message>
        <source>Saved. {holds}</source>
        <translation>已保存。{holds}</translation>
    </message>
    <message>
        <source>Something was changed and is not saved.</source>
        <translation>有更改尚未保存。</translation>
    </message>
    <message>
        <source>Do not save</source>
        <translation>不保存</translation>
    </message>
    <message>
        <source>Go on editing</source>
        <translation>继续编辑</translation>
    </message>
</context>
<context>
    <name>BoardDialog</name>
    <message>
        <source>Calibrate with a board</source>
        <translation>用标定板标定</translation>
    </message>
    <message>
        <source>No ball is needed. Show the board in a dozen places and tilts, to two cameras at a time.</source>
        <translation>不需要球。在十几个位置、以不同倾角展示标定板，每次让两台相机同时看到。</translation>
    </message>
    <message>
        <source>Board</source>
        <translation>标定板</translation>
    </message>
    <message>
        <source>The images show the rest (rows, columns, markers)</source>
        <translation>其余由图像得出（行数、列数、标记）</translation>
    </message>
    <message>
        <source>Save a sheet to print</source>
        <translation>保存待打印的页</translation>
    </message>
    <message>
        <source>Calibrate with this board</source>
        <translation>用此标定板标定</translation>
    </message>
    <message>
        <source>Images of this board</source>
        <translation>此标定板的图像</translation>
    </message>
    <message>
        <source>Chessboard</source>
        <translation>棋盘格</translation>
    </message>
    <message>
        <source>Circles</source>
        <translation>圆点</translation>
    </message>
    <message>
        <source>Circles, asymmetric</source>
        <translation>圆点（交错）</translation>
    </message>
    <message>
        <source>Rows of tags</source>
        <translation>标签行数</translation>
    </message>
    <message>
        <source>Rows of inner corners</source>
        <translation>内角点行数</translation>
    </message>
    <message>
        <source>Rows of dots</source>
        <translation>圆点行数</translation>
    </message>
    <message>
        <source>Columns of tags</source>
        <translation>标签列数</translation>
    </message>
    <message>
        <source>Columns of inner corners</source>
        <translation>内角点列数</translation>
    </message>
    <message>
        <source>Columns of dots</source>
        <translation>圆点列数</translation>
    </message>
    <message>
        <source>Side of a square</source>
        <translation>方格边长</translation>
    </message>
    <message>
        <source>From tag to tag</source>
        <translation>标签间距</translation>
    </message>
    <message>
        <source>From row to row</source>
        <translation>行间距</translation>
    </message>
    <message>
        <source>Side of a marker</source>
        <translation>标记边长</translation>
    </message>
    <message>
        <source>OpenCV&apos;s name of the markers</source>
        <translation>标记的 OpenCV 名称</translation>
    </message>
</context>
<context>
    <name>Bundle</name>
    <message>
        <source>Support bundle</source>
        <translation>支持包</translation>
    </message>
    <message>
        <source>Save a support bundle of {n} files? It contains no images.</source>
        <translation>要保存包含 {n} 个文件的支持包吗？其中没有图像。</translation>
    </message>
    <message>
        <source>Save</source>
        <translation>保存</translation>
    </message>
</context>
<context>
    <name>Calibrate</name>
    <message>
        <source>The calibration is finished: {verdict}.</source>
        <translation>标定完成：{verdict}。</translation>
    </message>
    <message>
        <source>The frame has changed: it was that of {before}, now it is that of {now}.</source>
        <translation>坐标系已改变：原来是 {before} 的，现在是 {now} 的。</translation>
    </message>
    <message>
        <source>{before} could not be placed. Coordinates of before do not fit these.</source>
        <translation>{before} 无法定位。以前的坐标与现在的不一致。</translation>
    </message>
    <message>
        <source>Cancelled. What was captured is kept.</source>
        <translation>已取消。已拍摄的内容保留。</translation>
    </message>
</context>
<context>
    <name>CalibratePage</name>
    <message>
        <source>Stop here</source>
        <translation>到此为止</translation>
    </message>
    <message>
        <source>What goes into it</source>
        <translation>计算所用</translation>
    </message>
    <message>
        <source>Captured</source>
        <translation>已拍摄</translation>
    </message>
    <message>
        <source>cameras</source>
        <translation>相机</translation>
    </message>
    <message>
        <source>dots</source>
        <translation>圆点</translation>
    </message>
    <message>
        <source>state</source>
        <translation>状态</translation>
    </message>
    <message>
        <source>Green: where each camera has seen dots, over all placements.</source>
        <translation>绿色：各相机在所有摆放中看到圆点的区域。</translation>
    </message>
    <message>
        <source>Stages</source>
        <translation>计算阶段</translation>
    </message>
    <message>
        <source>Convergence</source>
        <translation>收敛过程</translation>
    </message>
    <message>
        <source>Details</source>
        <translation>详细信息</translation>
    </message>
    <message>
        <source>Log</source>
        <translation>日志</translation>
    </message>
    <message>
        <source>Log of the computation</source>
        <translation>计算日志</translation>
    </message>
    <message>
        <source>ours (recommended)</source>
        <translation>本程序的（推荐）</translation>
    </message>
    <message>
        <source>the paper&apos;s (Tao et al., 2021)</source>
        <translation>论文的（Tao 等，2021）</translation>
    </message>
    <message>
        <source>Method of the calibration</source>
        <translation>标定方法</translation>
    </message>
    <message>
        <source>Method</source>
        <translation>方法</translation>
    </message>
    <message>
        <source>captured</source>
        <translation>已拍摄</translation>
    </message>
    <message>
        <source>not captured</source>
        <translation>未拍摄</translation>
    </message>
    <message>
        <source>The last calibration is valid and would be lost: cancel instead.</source>
        <translation>上一次标定有效，会被覆盖：请改用取消。</translation>
    </message>
    <message>
        <source>It was asked for.</source>
        <translation>已提出请求。</translation>
    </message>
    <message>
        <source>Ends as soon as there is something to look at. Such a result is not valid.</source>
        <translation>一有可看的结果就结束。这样的结果无效。</translation>
    </message>
    <message>
        <source>Done when the line falls no more. Each adjustment goes on where the one before ended.</source>
        <translation>曲线不再下降即完成。每次平差从上一次结束处继续。</translation>
    </message>
    <message>
        <source>With the paper&apos;s method lengths are less certain. The report names the method.</source>
        <translation>用论文的方法时长度的不确定度更大。报告会注明所用方法。</translation>
    </message>
    <message>
        <source>Calibrate again</source>
        <translation>重新标定</translation>
    </message>
</context>
<context>
    <name>CameraDialog</name>
    <message>
        <source>Hold a hand before a lens: the picture that goes dark is that camera&apos;s.</source>
        <translation>用手挡住镜头：变暗的画面就是那台相机。</translation>
    </message>
    <message>
        <source>Let its light blink</source>
        <translation>让指示灯闪烁</translation>
    </message>
    <message>
        <source>These cameras have no light.</source>
        <translation>这些相机没有指示灯。</translation>
    </message>
    <message>
        <source>Name</source>
        <translation>名称</translation>
    </message>
    <message>
        <source>Exposure</source>
        <translation>曝光</translation>
    </message>
    <message>
        <source>Gain</source>
        <translation>增益</translation>
    </message>
    <message>
        <source>Trigger of all cameras</source>
        <translation>所有相机的触发方式</translation>
    </message>
    <message>
        <source>Software, one after the other</source>
        <translation>软件触发，逐台曝光</translation>
    </message>
    <message>
        <source>Common clock (IEEE 1588), all at once</source>
        <translation>共同时钟 (IEEE 1588)，同时曝光</translation>
    </message>
    <message>
        <source>Trigger box, all at once</source>
        <translation>触发盒，同时曝光</translation>
    </message>
    <message>
        <source>None: free running</source>
        <translation>无：自由运行</translation>
    </message>
    <message>
        <source>Apply</source>
        <translation>应用</translation>
    </message>
    <message>
        <source>Close</source>
        <translation>关闭</translation>
    </message>
    <message>
        <source>Work is running.</source>
        <translation>正在运行。</translation>
    </message>
    <message>
        <source>Its light blinks for some seconds.</source>
        <translation>指示灯将闪烁几秒钟。</translation>
    </message>
    <message>
        <source>This camera has no light that can be switched.</source>
        <translation>此相机没有可控的指示灯。</translation>
    </message>
</context>
<context>
    <name>CameraRow</name>
    <message>
        <source>{name} in this rig</source>
        <translation>{name} 属于本系统</translation>
    </message>
    <message>
        <source>Which is it?</source>
        <translation>是哪一台？</translation>
    </message>
    <message>
        <source>Its picture, its name, exposure and gain; its light, where it has one.</source>
        <translation>其图像、名称、曝光和增益；如有指示灯可闪烁。</translation>
    </message>
    <message>
        <source>Address</source>
        <translation>地址</translation>
    </message>
    <message>
        <source>Give it an address</source>
        <translation>分配地址</translation>
    </message>
    <message>
        <source>A free one of this computer&apos;s network, kept in the camera.</source>
        <translation>本机网络中的空闲地址，并保存在相机中。</translation>
    </message>
    <message>
        <source>Placements are captured already: begin a new calibration.</source>
        <translation>已采集摆放：请开始新的标定。</translation>
    </message>
    <message>
        <source>Work is running.</source>
        <translation>正在工作。</translation>
    </message>
    <message>
        <source>In this rig: whoever is left out is not opened and hinders nobody.</source>
        <translation>属于本系统：被排除的相机不会打开，也不妨碍其他相机。</translation>
    </message>
    <message>
        <source>Driver</source>
        <translation>驱动</translation>
    </message>
    <message>
        <source>Use the built-in driver</source>
        <translation>使用内置驱动</translation>
    </message>
    <message>
        <source>For GigE and USB3 Vision cameras of any maker.</source>
        <translation>适用于任何厂商的 GigE 和 USB3 Vision 相机。</translation>
    </message>
</context>
<context>
    <name>CameraTile</name>
    <message>
        <source>no image yet</source>
        <translation>尚无图像</translation>
    </message>
    <message>
        <source>{count} dots</source>
        <translation>{count} 个点</translation>
    </message>
    <message>
        <source>Name of the camera</source>
        <translation>相机名称</translation>
    </message>
</context>
<context>
    <name>Cameras</name>
    <message>
        <source>Another program is using it. Close that program.</source>
        <translation>被其他程序占用。请关闭该程序。</translation>
    </message>
</context>
<context>
    <name>Check</name>
    <message>
        <source>REPAIRED</source>
        <translation>已修复</translation>
    </message>
    <message>
        <source>Not in use yet.</source>
        <translation>尚未启用。</translation>
    </message>
    <message>
        <source>The measured lengths of the bars agree with their certificates; single cameras were not checked.</source>
        <translation>基准尺的测量值与证书一致；未检查单台相机。</translation>
    </message>
    <message>
        <source>The rig is as it was calibrated: {count} cameras agree with one another.</source>
        <translation>系统与标定时一致：{count} 台相机相互吻合。</translation>
    </message>
    <message>
        <source>Only {camera} moved ({px} px). Tighten its mount.</source>
        <translation>只有 {camera} 移动了（{px} px）。请拧紧支架。</translation>
    </message>
    <message>
        <source>Moved: {cameras}.</source>
        <translation>已移动：{cameras}。</translation>
    </message>
    <message>
        <source>Less sharp than before: {cameras}.</source>
        <translation>比以前模糊：{cameras}。</translation>
    </message>
    <message>
        <source>{cameras} repaired: a point was off by {before:.3f} mm, now by {now:.3f} mm.</source>
        <translation>{cameras} 已修复：点位偏差之前为 {before:.3f} mm，现在为 {now:.3f} mm。</translation>
    </message>
    <message>
        <source>{cameras} repaired and in use: {before:.3f} mm before, {now:.3f} mm now.</source>
        <translation>{cameras} 已修复并启用：之前 {before:.3f} mm，现在 {now:.3f} mm。</translation>
    </message>
    <message>
        <source>A camera must be recalibrated where a point is off by more than {mm:.3f} mm.</source>
        <translation>若某点偏差超过 {mm:.3f} mm，则该相机必须重新标定。</translation>
    </message>
    <message>
        <source>Not checked, since they saw too little: {cameras}.</source>
        <translation>观测太少而未检查：{cameras}。</translation>
    </message>
    <message>
        <source>The ball is measured {ppm:+.0f} ± {sd:.0f} ppm against the calibration.</source>
        <translation>球的测量值相对标定偏差 {ppm:+.0f} ± {sd:.0f} ppm。</translation>
    </message>
    <message>
        <source>The check is finished: {verdict}.</source>
        <translation>检查完成：{verdict}。</translation>
    </message>
    <message>
        <source>The repair is finished: {verdict}.</source>
        <translation>修复完成：{verdict}。</translation>
    </message>
    <message>
        <source>The repaired calibration is in use, as number {number}.</source>
        <translation>修复后的标定已启用，编号 {number}。</translation>
    </message>
    <message>
        <source>repaired after a check: {cameras}</source>
        <translation>检查后修复：{cameras}</translation>
    </message>
</context>
<context>
    <name>CheckPage</name>
    <message>
        <source>Calibrate the rig</source>
        <translation>标定系统</translation>
    </message>
    <message>
        <source>Camera</source>
        <translation>相机</translation>
    </message>
    <message>
        <source>state</source>
        <translation>状态</translation>
    </message>
    <message>
        <source>moved
px</source>
        <translation>移动
px</translation>
    </message>
    <message>
        <source>a point is off
mm</source>
        <translation>点偏差
mm</translation>
    </message>
    <message>
        <source>shift
mm</source>
        <translation>平移
mm</translation>
    </message>
    <message>
        <source>turn
deg</source>
        <translation>转角
度</translation>
    </message>
    <message>
        <source>rms now
px</source>
        <translation>当前 rms
px</translation>
    </message>
    <message>
        <source>rms then
px</source>
        <translation>标定时 rms
px</translation>
    </message>
    <message>
        <source>Repair</source>
        <translation>修复</translation>
    </message>
    <message>
        <source>Calibrates only the cameras that moved, from this placement; seconds.</source>
        <translation>只用此次摆放标定移动过的相机；几秒钟。</translation>
    </message>
    <message>
        <source>Put the repair to use</source>
        <translation>启用修复结果</translation>
    </message>
    <message>
        <source>Repair {cameras}</source>
        <translation>修复 {cameras}</translation>
    </message>
    <message>
        <source>The repair is not valid: calibrate the rig.</source>
        <translation>修复无效：请标定整个系统。</translation>
    </message>
    <message>
        <source>No bar has verified it, and the limits forbid its use: calibrate the rig and verify it.</source>
        <translation>未经基准尺验证，限值不允许启用：请标定系统并验证。</translation>
    </message>
    <message>
        <source>Check again to see the numbers.</source>
        <translation>再次检查以查看数值。</translation>
    </message>
    <message>
        <source>Check again</source>
        <translation>再次检查</translation>
    </message>
</context>
<context>
    <name>Connect</name>
    <message>
        <source>missing: plug it in, then search again</source>
        <translation>缺失：请接好后重新查找</translation>
    </message>
    <message>
        <source>{count} called {name}</source>
        <translation>{count} 台同名 {name}</translation>
    </message>
    <message>
        <source>left out of the rig</source>
        <translation>已排除在系统之外</translation>
    </message>
    <message>
        <source>It answers, but no driver reaches it.</source>
        <translation>它有应答，但没有驱动能访问它。</translation>
    </message>
    <message>
        <source>It answers, but no driver reaches it: install {package}.</source>
        <translation>它有应答，但没有驱动能访问它：请安装 {package}。</translation>
    </message>
    <message>
        <source>Its address {address} is in another subnet than this computer.</source>
        <translation>其地址 {address} 与本机不在同一子网。</translation>
    </message>
    <message>
        <source>simulated {size}</source>
        <translation>仿真 {size}</translation>
    </message>
    <message>
        <source>not opened</source>
        <translation>未打开</translation>
    </message>
    <message>
        <source>link: {share:.0f} % of the images damaged. Check cable, switch and packet size.</source>
        <translation>链路：{share:.0f} % 的图像损坏。请检查电缆、交换机和包大小。</translation>
    </message>
    <message>
        <source>ready</source>
        <translation>就绪</translation>
    </message>
    <message>
        <source>Looking for cameras</source>
        <translation>正在查找相机</translation>
    </message>
    <message>
        <source>Cameras that answer, but cannot be used yet: {count}</source>
        <translation>有应答但尚不能使用的相机：{count}</translation>
    </message>
    <message>
        <source>No cameras yet</source>
        <translation>尚无相机</translation>
    </message>
    <message>
        <source>{good} of {all} cameras ready</source>
        <translation>{good}/{all} 台相机就绪</translation>
    </message>
    <message>
        <source>{good} of {all} cameras ready, without {cameras}</source>
        <translation>{good}/{all} 台相机就绪，缺少 {cameras}</translation>
    </message>
    <message>
        <source>{nominal} nominal, {certified} certified</source>
        <translation>标称 {nominal}，证书 {certified}</translation>
    </message>
    <message>
        <source>This recording is damaged.</source>
        <translation>此采集数据已损坏。</translation>
    </message>
    <message>
        <source>This folder contains no recording.</source>
        <translation>此文件夹中没有采集数据。</translation>
    </message>
    <message>
        <source>not known: describe the bench</source>
        <translation>未知：请描述器具</translation>
    </message>
    <message>
        <source>Targets</source>
        <translation>靶标</translation>
    </message>
    <message>
        <source>none: lengths will be arbitrary</source>
        <translation>无：长度将是任意的</translation>
    </message>
    <message>
        <source>none: the result cannot be verified</source>
        <translation>无：结果无法验证</translation>
    </message>
    <message>
        <source>Certificates</source>
        <translation>证书</translation>
    </message>
    <message>
        <source>Targets on the ball</source>
        <translation>球上的靶标</translation>
    </message>
    <message>
        <source>Ball, about</source>
        <translation>球，约</translation>
    </message>
    <message>
        <source>Scale from</source>
        <translation>比例尺来源</translation>
    </message>
    <message>
        <source>Verified by</source>
        <translation>验证依据</translation>
    </message>
    <message>
        <source>It is not known which targets are on the ball.</source>
        <translation>不知道球上贴的是哪些靶标。</translation>
    </message>
    <message>
        <source>Choose the file that describes the bench.</source>
        <translation>请选择描述器具的文件。</translation>
    </message>
    <message>
        <source>The names come from the recording or the simulated rig.</source>
        <translation>名称来自采集数据或仿真系统。</translation>
    </message>
    <message>
        <source>Placements were captured under this name: begin a new calibration to change it.</source>
        <translation>已用此名称拍摄过摆放：如需更改，请开始新的标定。</translation>
    </message>
    <message>
        <source>The description of the bench names this camera.</source>
        <translation>器具描述中已指定此相机的名称。</translation>
    </message>
    <message>
        <source>Simulated cameras are all exposed at the same moment.</source>
        <translation>仿真相机全部在同一时刻曝光。</translation>
    </message>
    <message>
        <source>Another camera has the name {name}.</source>
        <translation>另一台相机已名为 {name}。</translation>
    </message>
    <message>
        <source>Board</source>
        <translation>标定板</translation>
    </message>
    <message>
        <source>Scale from the board&apos;s pitch</source>
        <translation>比例尺来自标定板的间距</translation>
    </message>
    <message>
        <source>This computer&apos;s network does not say which addresses are free.</source>
        <translation>无法得知本机网络中哪些地址空闲。</translation>
    </message>
    <message>
        <source>Give the camera an address with its maker&apos;s program.</source>
        <translation>请用厂家的程序为相机分配地址。</translation>
    </message>
</context>
<context>
    <name>ConnectPage</name>
    <message>
        <source>Cameras</source>
        <translation>相机</translation>
    </message>
    <message>
        <source>Choose another</source>
        <translation>另选一个</translation>
    </message>
    <message>
        <source>Search again</source>
        <translation>重新查找</translation>
    </message>
    <message>
        <source>On the bench</source>
        <translation>器具</translation>
    </message>
    <message>
        <source>Compare with what lies there: the targets&apos; numbers, the names and lengths on the bars.</source>
        <translation>请与现场实物核对：靶标编号、基准尺上的名称和长度。</translation>
    </message>
    <message>
        <source>Choose another description</source>
        <translation>选择其他描述</translation>
    </message>
    <message>
        <source>Describe the bench</source>
        <translation>描述器具</translation>
    </message>
    <message>
        <source>Ball, targets, bars with their certificates, limits.</source>
        <translation>球、靶标、带证书的基准尺、限值。</translation>
    </message>
    <message>
        <source>Placements are captured already: begin a new calibration.</source>
        <translation>已采集摆放：请开始新的标定。</translation>
    </message>
    <message>
        <source>Work is running.</source>
        <translation>正在工作。</translation>
    </message>
    <message>
        <source>Placements are captured already: begin a new calibration for another bench.</source>
        <translation>已有拍摄内容：更换器具请新建标定。</translation>
    </message>
    <message>
        <source>A session.json, or the folder of an earlier session.</source>
        <translation>session.json 文件，或以前会话的文件夹。</translation>
    </message>
    <message>
        <source>Description of the bench</source>
        <translation>器具描述</translation>
    </message>
</context>
<context>
    <name>ConvergenceChart</name>
    <message>
        <source>iteration</source>
        <translation>迭代</translation>
    </message>
    <message>
        <source>misfit, 1 at the start</source>
        <translation>偏差，起始为 1</translation>
    </message>
</context>
<context>
    <name>Details</name>
    <message>
        <source>Details</source>
        <translation>详细信息</translation>
    </message>
</context>
<context>
    <name>DeviationChart</name>
    <message>
        <source>s</source>
        <translation>秒</translation>
    </message>
</context>
<context>
    <name>Drivers</name>
    <message>
        <source>A new camera driver</source>
        <translation>新的相机驱动</translation>
    </message>
    <message>
        <source>May this camera driver be loaded? It was never used here before.</source>
        <translation>是否加载此相机驱动？此前从未在此使用。</translation>
    </message>
    <message>
        <source>May this camera driver be loaded? Its file has changed since it was allowed.</source>
        <translation>是否加载此相机驱动？自允许以来文件已更改。</translation>
    </message>
    <message>
        <source>Install the driver package of the cameras&apos; maker, then search again.</source>
        <translation>请安装相机厂商的驱动包，然后重新查找。</translation>
    </message>
    <message>
        <source>Installed already? {name} must name the folder of its .cti file.</source>
        <translation>已安装？{name} 必须指向其 .cti 文件所在的文件夹。</translation>
    </message>
    <message>
        <source>Install the 64-bit driver package of the cameras&apos; maker, then restart SphereCal.</source>
        <translation>请安装相机厂商的 64 位驱动包，然后重新启动 SphereCal。</translation>
    </message>
    <message>
        <source>Or the built-in driver, for GigE and USB3 Vision cameras of any maker: {line}</source>
        <translation>或使用内置驱动，适用于各厂家的 GigE 与 USB3 Vision 相机：{line}</translation>
    </message>
    <message>
        <source>No camera driver is installed.</source>
        <translation>没有安装相机驱动。</translation>
    </message>
    <message>
        <source>The driver does not reach these cameras: {names}.</source>
        <translation>该驱动无法访问这些相机：{names}。</translation>
    </message>
    <message>
        <source>The driver {name} is not allowed, so it was not loaded.</source>
        <translation>驱动 {name} 未被允许，因此没有加载。</translation>
    </message>
    <message>
        <source>A driver is a program. Load it only if you or its maker have installed it.</source>
        <translation>驱动是程序。仅当由您或厂商安装时才加载。</translation>
    </message>
    <message>
        <source>The driver {name} does not work.</source>
        <translation>驱动 {name} 无法工作。</translation>
    </message>
    <message>
        <source>Install it again with its maker&apos;s installer; never copy the file alone.</source>
        <translation>请用厂商的安装程序重新安装；切勿只复制该文件。</translation>
    </message>
    <message>
        <source>The driver works, but sees no camera: {names}.</source>
        <translation>驱动可用，但没有发现相机：{names}。</translation>
    </message>
    <message>
        <source>Power and cables: is the light at each camera&apos;s plug on?</source>
        <translation>电源与电缆：每台相机插口的指示灯亮吗？</translation>
    </message>
    <message>
        <source>Close the maker&apos;s own viewer and any other program that holds the cameras.</source>
        <translation>请关闭厂商的查看程序和其他占用相机的程序。</translation>
    </message>
    <message>
        <source>Some drivers only see their own maker&apos;s cameras: install that of your cameras.</source>
        <translation>有些驱动只识别本厂相机：请安装您的相机所用的驱动。</translation>
    </message>
    <message>
        <source>GigE: let SphereCal through the Windows firewall, in private networks too.</source>
        <translation>GigE：请让 SphereCal 通过 Windows 防火墙，专用网络也要允许。</translation>
    </message>
    <message>
        <source>USB3: Device Manager must show the cameras with their maker&apos;s driver.</source>
        <translation>USB3：设备管理器中相机应使用其厂商的驱动。</translation>
    </message>
    <message>
        <source>GigE: spherecal cameras doctor examines the network line.</source>
        <translation>GigE：spherecal cameras doctor 可检查网络线路。</translation>
    </message>
    <message>
        <source>USB3: replug the cameras after installing the driver (its udev rules).</source>
        <translation>USB3：安装驱动后请重新插拔相机（udev 规则）。</translation>
    </message>
    <message>
        <source>any maker (GigE, USB3 Vision)</source>
        <translation>任何厂商 (GigE, USB3 Vision)</translation>
    </message>
    <message>
        <source>as its installer says</source>
        <translation>以其安装程序所示为准</translation>
    </message>
    <message>
        <source>Load it</source>
        <translation>加载</translation>
    </message>
    <message>
        <source>Do not load it</source>
        <translation>不加载</translation>
    </message>
</context>
<context>
    <name>DriversPanel</name>
    <message>
        <source>Makers and their drivers</source>
        <translation>厂商及其驱动</translation>
    </message>
    <message>
        <source>Allow this driver</source>
        <translation>允许此驱动</translation>
    </message>
    <message>
        <source>Use the built-in driver</source>
        <translation>使用内置驱动</translation>
    </message>
    <message>
        <source>Do it now</source>
        <translation>立即执行</translation>
    </message>
</context>
<context>
    <name>Effects</name>
    <message>
        <source>Every lens does what its model says.</source>
        <translation>每个镜头都符合其模型。</translation>
    </message>
    <message>
        <source>The lens of {camera} is farthest from its model: {px:.3f} px. It is corrected.</source>
        <translation>{camera} 的镜头偏离其模型最多：{px:.3f} px。已作校正。</translation>
    </message>
    <message>
        <source>No camera turned over the placements.</source>
        <translation>各次摆放期间没有相机转动。</translation>
    </message>
    <message>
        <source>{camera} turned most over the placements: {px:.2f} px. Look at its mount and cable.</source>
        <translation>各次摆放期间 {camera} 转动最多：{px:.2f} px。请检查其支架和电缆。</translation>
    </message>
</context>
<context>
    <name>Errors</name>
    <message>
        <source>Something went wrong inside the program ({kind}: {text}).</source>
        <translation>程序内部出错（{kind}：{text}）。</translation>
    </message>
    <message>
        <source>What was recorded is safe. Try again; if it happens again, send the log to us.</source>
        <translation>已记录的内容安全。请重试；若再次发生，请将日志发给我们。</translation>
    </message>
    <message>
        <source>No camera was found.</source>
        <translation>未找到相机。</translation>
    </message>
    <message>
        <source>Plug the cameras in and switch them on; no other program may hold them.</source>
        <translation>请接好并打开相机；其他程序不得占用它们。</translation>
    </message>
    <message>
        <source>No camera delivered an image of {name}.</source>
        <translation>没有相机提供 {name} 的图像。</translation>
    </message>
    <message>
        <source>Check the cameras at Connect.</source>
        <translation>请在“连接”步骤检查相机。</translation>
    </message>
    <message>
        <source>Retake {name}: what is on disk is damaged.</source>
        <translation>请重拍 {name}：磁盘上的数据已损坏。</translation>
    </message>
</context>
<context>
    <name>FindingsList</name>
    <message>
        <source>Nothing to complain about.</source>
        <translation>没有问题。</translation>
    </message>
    <message>
        <source>{title}: {where}</source>
        <translation>{title}：{where}</translation>
    </message>
    <message>
        <source>It is already requested: calibrate again.</source>
        <translation>已提出要求：请重新标定。</translation>
    </message>
    <message>
        <source>Asked for: {repair}</source>
        <translation>已要求：{repair}</translation>
    </message>
    <message>
        <source>Take back</source>
        <translation>撤回</translation>
    </message>
</context>
<context>
    <name>Footer</name>
    <message>
        <source>Back</source>
        <translation>返回</translation>
    </message>
    <message>
        <source>Show me</source>
        <translation>带我去</translation>
    </message>
    <message>
        <source>Next</source>
        <translation>下一步</translation>
    </message>
    <message>
        <source>This is the first step.</source>
        <translation>这是第一步。</translation>
    </message>
</context>
<context>
    <name>Frame</name>
    <message>
        <source>{name}: the ball&apos;s centre</source>
        <translation>{name}：球心</translation>
    </message>
    <message>
        <source>{name}: mark of a bar</source>
        <translation>{name}：基准尺标记</translation>
    </message>
    <message>
        <source>{name}: a point</source>
        <translation>{name}：一个点</translation>
    </message>
    <message>
        <source>the reference camera&apos;s frame ({camera})</source>
        <translation>参考相机坐标系（{camera}）</translation>
    </message>
    <message>
        <source>the user&apos;s frame: origin {origin}, X axis to {x}, XY plane with {xy}</source>
        <translation>用户坐标系：原点 {origin}，X 轴指向 {x}，XY 平面经过 {xy}</translation>
    </message>
    <message>
        <source>, offset {offset} mm</source>
        <translation>，偏移 {offset} mm</translation>
    </message>
    <message>
        <source>, turned {turns}</source>
        <translation>，旋转 {turns}</translation>
    </message>
    <message>
        <source>Exports are given in: {frame}.</source>
        <translation>导出所用坐标系：{frame}。</translation>
    </message>
    <message>
        <source>{origin} lies at {x} / {y} / {z} mm; {to} is {distance} mm from it, {xy} {angle}° off.</source>
        <translation>{origin} 位于 {x} / {y} / {z} mm；{to} 距它 {distance} mm，{xy} 偏离 {angle}°。</translation>
    </message>
    <message>
        <source>Uncertainty (k = 1): origin {mm} mm, axes {deg}°.</source>
        <translation>不确定度（k = 1）：原点 {mm} mm，轴 {deg}°。</translation>
    </message>
    <message>
        <source>The frame of this project cannot be made with this calibration: {why}</source>
        <translation>无法用本次标定建立该项目的坐标系：{why}</translation>
    </message>
    <message>
        <source>Choose origin and axes again.</source>
        <translation>请重新选择原点和坐标轴。</translation>
    </message>
    <message>
        <source>Verify again, or choose origin and axes again.</source>
        <translation>请重新验证，或重新选择原点和坐标轴。</translation>
    </message>
</context>
<context>
    <name>FrameDialog</name>
    <message>
        <source>Origin and axes</source>
        <translation>原点和坐标轴</translation>
    </message>
    <message>
        <source>Turn the axes by 90 degrees:</source>
        <translation>将坐标轴旋转 90 度：</translation>
    </message>
    <message>
        <source>The origin&apos;s place lies at:</source>
        <translation>原点位置的坐标：</translation>
    </message>
    <message>
        <source>Origin</source>
        <translation>原点</translation>
    </message>
    <message>
        <source>X axis to</source>
        <translation>X 轴指向</translation>
    </message>
    <message>
        <source>XY plane with</source>
        <translation>XY 平面经过</translation>
    </message>
    <message>
        <source>the reference camera</source>
        <translation>参考相机</translation>
    </message>
    <message>
        <source>Offset along {axis}, mm</source>
        <translation>沿 {axis} 的偏移，mm</translation>
    </message>
    <message>
        <source>Turn the axes about {axis} by {angle} degrees</source>
        <translation>将坐标轴绕 {axis} 旋转 {angle} 度</translation>
    </message>
    <message>
        <source>Undo</source>
        <translation>撤销</translation>
    </message>
    <message>
        <source>No offset, no turns</source>
        <translation>无偏移、无旋转</translation>
    </message>
    <message>
        <source>Back to the reference camera</source>
        <translation>恢复为参考相机</translation>
    </message>
    <message>
        <source>Cancel</source>
        <translation>取消</translation>
    </message>
    <message>
        <source>OK</source>
        <translation>确定</translation>
    </message>
    <message>
        <source>Nothing was changed yet.</source>
        <translation>尚未更改任何内容。</translation>
    </message>
    <message>
        <source>It is chosen already.</source>
        <translation>已经选择。</translation>
    </message>
</context>
<context>
    <name>Guidance</name>
    <message>
        <source>If you stop now: being worked out</source>
        <translation>若现在停止：正在计算</translation>
    </message>
    <message>
        <source>If you stop now: not determined yet</source>
        <translation>若现在停止：尚未确定</translation>
    </message>
    <message>
        <source>If you stop now: 500 ± {mm:.3f} mm</source>
        <translation>若现在停止：500 ± {mm:.3f} mm</translation>
    </message>
    <message>
        <source>With this placement: 500 ± {mm:.3f} mm</source>
        <translation>加上这次摆放：500 ± {mm:.3f} mm</translation>
    </message>
    <message>
        <source>With one more placement: 500 ± {mm:.3f} mm</source>
        <translation>再摆放一次：500 ± {mm:.3f} mm</translation>
    </message>
</context>
<context>
    <name>Header</name>
    <message>
        <source>Start page</source>
        <translation>起始页</translation>
    </message>
    <message>
        <source>Larger letters, to read from three metres.</source>
        <translation>大号文字，三米外可读。</translation>
    </message>
    <message>
        <source>Dark</source>
        <translation>深色</translation>
    </message>
    <message>
        <source>Menu</source>
        <translation>菜单</translation>
    </message>
    <message>
        <source>Light letters on a dark ground.</source>
        <translation>深色背景，浅色文字。</translation>
    </message>
    <message>
        <source>Large text</source>
        <translation>大字</translation>
    </message>
    <message>
        <source>Mute</source>
        <translation>静音</translation>
    </message>
    <message>
        <source>No sounds for accepted, rejected and done.</source>
        <translation>接受、拒绝和完成时不发声。</translation>
    </message>
    <message>
        <source>Go on by itself</source>
        <translation>自动进入下一步</translation>
    </message>
    <message>
        <source>On to the next step a second after one is done and nothing is wrong.</source>
        <translation>一步完成且无异常时，一秒后进入下一步。</translation>
    </message>
    <message>
        <source>Log</source>
        <translation>日志</translation>
    </message>
    <message>
        <source>What the program has done, line by line.</source>
        <translation>逐行记录程序所做的操作。</translation>
    </message>
    <message>
        <source>Copy as command</source>
        <translation>复制为命令</translation>
    </message>
    <message>
        <source>Test the sound</source>
        <translation>测试声音</translation>
    </message>
    <message>
        <source>Language</source>
        <translation>语言</translation>
    </message>
    <message>
        <source>Train on a simulated rig</source>
        <translation>在仿真系统上练习</translation>
    </message>
    <message>
        <source>a surprise</source>
        <translation>随机故障</translation>
    </message>
    <message>
        <source>Help  F1</source>
        <translation>帮助  F1</translation>
    </message>
    <message>
        <source>Bench, bars and balls</source>
        <translation>器具、基准尺和球</translation>
    </message>
    <message>
        <source>Limits</source>
        <translation>限值</translation>
    </message>
    <message>
        <source>Save a support bundle</source>
        <translation>保存支持包</translation>
    </message>
    <message>
        <source>About SphereCal</source>
        <translation>关于 SphereCal</translation>
    </message>
</context>
<context>
    <name>Help</name>
    <message>
        <source>There is no help for this step.</source>
        <translation>此步骤没有帮助。</translation>
    </message>
    <message>
        <source>Help</source>
        <translation>帮助</translation>
    </message>
</context>
<context>
    <name>HistogramChart</name>
    <message>
        <source>residual, px</source>
        <translation>残差，px</translation>
    </message>
    <message>
        <source>dots</source>
        <translation>点数</translation>
    </message>
</context>
<context>
    <name>Hooks</name>
    <message>
        <source>Something went wrong inside the program. What was recorded is safe.</source>
        <translation>程序内部出错。已记录的内容安全。</translation>
    </message>
    <message>
        <source>You can go on. If it happens again, send these details to us.</source>
        <translation>您可以继续。若再次发生，请将这些信息发给我们。</translation>
    </message>
    <message>
        <source>Save a support bundle</source>
        <translation>保存支持包</translation>
    </message>
</context>
<context>
    <name>ImportDialog</name>
    <message>
        <source>Import images</source>
        <translation>导入图像</translation>
    </message>
    <message>
        <source>not known</source>
        <translation>未知</translation>
    </message>
    <message>
        <source>Diameter of the ball</source>
        <translation>球的直径</translation>
    </message>
    <message>
        <source>They show a board, not the ball</source>
        <translation>图像显示的是标定板，不是球</translation>
    </message>
    <message>
        <source>The images are copied. Lenses that the images do not name are assumed.</source>
        <translation>图像将被复制。图像未注明的镜头按假定值处理。</translation>
    </message>
    <message>
        <source>Cancel</source>
        <translation>取消</translation>
    </message>
    <message>
        <source>Import</source>
        <translation>导入</translation>
    </message>
    <message>
        <source>Folder</source>
        <translation>文件夹</translation>
    </message>
    <message>
        <source>Read as</source>
        <translation>读作</translation>
    </message>
    <message>
        <source>Cameras: {count}</source>
        <translation>相机：{count}</translation>
    </message>
    <message>
        <source>Placements: {count}</source>
        <translation>摆放：{count}</translation>
    </message>
    <message>
        <source>Left out: {count}</source>
        <translation>已略去：{count}</translation>
    </message>
    <message>
        <source>Importing</source>
        <translation>正在导入</translation>
    </message>
</context>
<context>
    <name>LensBar</name>
    <message>
        <source>Focal length of all lenses</source>
        <translation>所有镜头的焦距</translation>
    </message>
    <message>
        <source>not known: found from the ball</source>
        <translation>未知：由球确定</translation>
    </message>
    <message>
        <source>Pixel pitch</source>
        <translation>像元尺寸</translation>
    </message>
    <message>
        <source>All lenses</source>
        <translation>所有镜头</translation>
    </message>
    <message>
        <source>pixels</source>
        <translation>像元</translation>
    </message>
    <message>
        <source>different ones</source>
        <translation>各不相同</translation>
    </message>
    <message>
        <source>not known</source>
        <translation>未知</translation>
    </message>
    <message>
        <source>On the lens. Not known: the calibration finds it from the ball.</source>
        <translation>标在镜头上。未知时由标定从球确定。</translation>
    </message>
    <message>
        <source>From the camera or its data sheet; only needed with a focal length in mm.</source>
        <translation>来自相机或其数据手册；仅在给出毫米焦距时需要。</translation>
    </message>
</context>
<context>
    <name>Limits</name>
    <message>
        <source>A calibration ages before it is out of date: give this one more.</source>
        <translation>标定先渐旧、后过期：请将此值设得更大。</translation>
    </message>
    <message>
        <source>yes</source>
        <translation>是</translation>
    </message>
    <message>
        <source>no</source>
        <translation>否</translation>
    </message>
    <message>
        <source>none</source>
        <translation>无</translation>
    </message>
    <message>
        <source>The responsible person of the rig sets these. They are kept in {path}.</source>
        <translation>由系统负责人设定。保存在 {path}。</translation>
    </message>
    <message>
        <source>{problem} Until then the delivered limits are used. Restore the file, or delete it to start again.</source>
        <translation>{problem} 在此之前使用出厂限值。请恢复该文件，或删除后重新开始。</translation>
    </message>
    <message>
        <source>The rig&apos;s profile still has others; saving here gives it these.</source>
        <translation>系统档案中的值仍不同；在此保存后将改为这些值。</translation>
    </message>
    <message>
        <source>Limit changed: {line}</source>
        <translation>限值已更改：{line}</translation>
    </message>
</context>
<context>
    <name>LimitsDialog</name>
    <message>
        <source>Limits</source>
        <translation>限值</translation>
    </message>
    <message>
        <source>Back to the delivered values</source>
        <translation>恢复出厂值</translation>
    </message>
    <message>
        <source>Save</source>
        <translation>保存</translation>
    </message>
    <message>
        <source>Close</source>
        <translation>关闭</translation>
    </message>
    <message>
        <source>Nothing was changed.</source>
        <translation>没有更改。</translation>
    </message>
    <message>
        <source>Close without saving</source>
        <translation>关闭而不保存</translation>
    </message>
    <message>
        <source>Saved; the new limits apply from now on.</source>
        <translation>已保存；新限值即刻生效。</translation>
    </message>
</context>
<context>
    <name>Log</name>
    <message>
        <source>project {folder}</source>
        <translation>项目 {folder}</translation>
    </message>
    <message>
        <source>{step}: started</source>
        <translation>{step}：开始</translation>
    </message>
    <message>
        <source>{step}: ended</source>
        <translation>{step}：结束</translation>
    </message>
    <message>
        <source>no advice for the next placement: {why}</source>
        <translation>无下一次摆放的建议：{why}</translation>
    </message>
    <message>
        <source>bench saved: {file}</source>
        <translation>器具已保存：{file}</translation>
    </message>
</context>
<context>
    <name>Look</name>
    <message>
        <source>waiting for the first image</source>
        <translation>等待第一幅图像</translation>
    </message>
    <message>
        <source>looking for targets</source>
        <translation>正在查找靶标</translation>
    </message>
    <message>
        <source>moved by {px:.0f} px, alone. Is it fixed?</source>
        <translation>仅此相机移动了 {px:.0f} px。固定好了吗？</translation>
    </message>
    <message>
        <source>no targets in sight</source>
        <translation>看不到靶标</translation>
    </message>
    <message>
        <source>no images since {time}</source>
        <translation>自 {time} 起无图像</translation>
    </message>
    <message>
        <source>too bright: {share} % clipped. Shorten the exposure.</source>
        <translation>过亮：{share} % 饱和。请缩短曝光。</translation>
    </message>
    <message>
        <source>{camera} is too bright.</source>
        <translation>{camera} 过亮。</translation>
    </message>
    <message>
        <source>{camera} is too dark.</source>
        <translation>{camera} 过暗。</translation>
    </message>
    <message>
        <source>dark. Lens cap, light, or exposure?</source>
        <translation>过暗。镜头盖、照明还是曝光？</translation>
    </message>
    <message>
        <source>brightness {own} %, the others {usual} %. Open the aperture or expose longer.</source>
        <translation>亮度 {own} %，其他相机 {usual} %。请开大光圈或延长曝光。</translation>
    </message>
    <message>
        <source>Out of focus ({blur:.1f} px). Turn the focus ring until this falls.</source>
        <translation>失焦（{blur:.1f} px）。转动对焦环直到数值下降。</translation>
    </message>
    <message>
        <source>{camera} is out of focus.</source>
        <translation>{camera} 失焦。</translation>
    </message>
    <message>
        <source>All {count} cameras: sharp, dots found.</source>
        <translation>全部 {count} 台相机：清晰，已找到圆点。</translation>
    </message>
    <message>
        <source>Only these moved: {names}.</source>
        <translation>仅以下相机被移动：{names}。</translation>
    </message>
    <message>
        <source>Only {name} moved ({px:.0f} px).</source>
        <translation>仅 {name} 被移动（{px:.0f} px）。</translation>
    </message>
    <message>
        <source>Tighten its mount, then press “Fixed again” at Camera check. Retake what was captured before: it no longer fits.</source>
        <translation>拧紧支架，然后在“相机检查”页按“已重新固定”。之前拍摄的内容不再吻合：请重拍。</translation>
    </message>
    <message>
        <source>{temperature:.0f} °C</source>
        <translation>{temperature:.0f} °C</translation>
    </message>
    <message>
        <source>{rate:.0f} fps</source>
        <translation>{rate:.0f} 帧/秒</translation>
    </message>
    <message>
        <source>{ms:g} ms</source>
        <translation>{ms:g} ms</translation>
    </message>
    <message>
        <source>not needed here</source>
        <translation>此处不需要</translation>
    </message>
    <message>
        <source>sharp</source>
        <translation>清晰</translation>
    </message>
    <message>
        <source>Still warming up, in °C per minute: {rates}. Wait until it is less than 0.1: lenses move with it.</source>
        <translation>仍在升温（每分钟 °C）：{rates}。请等到低于 0.1：镜头会随之移动。</translation>
    </message>
    <message>
        <source>Check {names}.</source>
        <translation>请处理 {names}。</translation>
    </message>
    <message>
        <source>Looking for targets</source>
        <translation>正在查找靶标</translation>
    </message>
    <message>
        <source>Waiting for images of {names}.</source>
        <translation>等待 {names} 的图像。</translation>
    </message>
    <message>
        <source>Could be better: {names}.</source>
        <translation>尚可改进：{names}。</translation>
    </message>
    <message>
        <source>Not as wanted: {names}. Their driver took the nearest setting.</source>
        <translation>未按要求设置：{names}。其驱动采用了最接近的设置。</translation>
    </message>
</context>
<context>
    <name>LookPage</name>
    <message>
        <source>Set exposures</source>
        <translation>设置曝光</translation>
    </message>
    <message>
        <source>Each camera gets the longest exposure by which its dots are not saturated.</source>
        <translation>每台相机采用圆点不饱和的最长曝光时间。</translation>
    </message>
    <message>
        <source>Pixel format of all cameras</source>
        <translation>所有相机的像素格式</translation>
    </message>
    <message>
        <source>different gains</source>
        <translation>各不相同</translation>
    </message>
    <message>
        <source>Gain of all cameras</source>
        <translation>所有相机的增益</translation>
    </message>
    <message>
        <source>Mask reflections</source>
        <translation>遮挡反光</translation>
    </message>
    <message>
        <source>Draw a rectangle over a reflection: nothing in it counts as a target.</source>
        <translation>在反光处画一个矩形：其中的内容不算靶标。</translation>
    </message>
    <message>
        <source>Undo the last mask</source>
        <translation>撤销上一个遮挡</translation>
    </message>
    <message>
        <source>Clear all masks</source>
        <translation>清除全部遮挡</translation>
    </message>
    <message>
        <source>Fixed again</source>
        <translation>已重新固定</translation>
    </message>
    <message>
        <source>The cameras that were moved are fixed: they count as they stand now.</source>
        <translation>被移动的相机已固定：以现在的位置为准。</translation>
    </message>
    <message>
        <source>Worst first</source>
        <translation>最差在前</translation>
    </message>
    <message>
        <source>Draw rectangles over what is no target, then press “{button}” again.</source>
        <translation>在非靶标处画矩形，然后再次按“{button}”。</translation>
    </message>
    <message>
        <source>Masks: {count}</source>
        <translation>遮挡：{count}</translation>
    </message>
    <message>
        <source>Work is running.</source>
        <translation>正在运行。</translation>
    </message>
    <message>
        <source>There are no masks.</source>
        <translation>没有遮挡。</translation>
    </message>
</context>
<context>
    <name>MakersDialog</name>
    <message>
        <source>Makers and their drivers</source>
        <translation>厂商及其驱动</translation>
    </message>
    <message>
        <source>Install the maker&apos;s package; its driver is then found by itself. Never copy the .cti file.</source>
        <translation>请安装厂商的软件包，之后会自动找到其驱动。切勿复制 .cti 文件。</translation>
    </message>
    <message>
        <source>Maker</source>
        <translation>厂商</translation>
    </message>
    <message>
        <source>Package</source>
        <translation>软件包</translation>
    </message>
    <message>
        <source>Driver&apos;s file</source>
        <translation>驱动文件</translation>
    </message>
    <message>
        <source>Usual folder</source>
        <translation>通常的文件夹</translation>
    </message>
    <message>
        <source>Close</source>
        <translation>关闭</translation>
    </message>
</context>
<context>
    <name>Measure</name>
    <message>
        <source>{name}: off by {deviation}</source>
        <translation>{name}：偏差 {deviation}</translation>
    </message>
    <message>
        <source>Choose two points for their distance, three for the angle at the second.</source>
        <translation>选两个点得到距离，选三个点得到第二个点处的角度。</translation>
    </message>
    <message>
        <source>Choose two or three points, not more.</source>
        <translation>请选两个或三个点，不要更多。</translation>
    </message>
    <message>
        <source>Moved since the calibration: {cameras}. Check the rig before you measure on.</source>
        <translation>标定之后移动过：{cameras}。继续测量之前请检查系统。</translation>
    </message>
    <message>
        <source>No target is seen by two cameras.</source>
        <translation>没有靶标同时被两台相机看到。</translation>
    </message>
    <message>
        <source>Target {target}: {camera} contradicts the other cameras.</source>
        <translation>靶标 {target}：{camera} 与其他相机矛盾。</translation>
    </message>
    <message>
        <source>Target {target}: its views contradict one another.</source>
        <translation>靶标 {target}：各视图相互矛盾。</translation>
    </message>
    <message>
        <source>The cameras agree.</source>
        <translation>各相机一致。</translation>
    </message>
    <message>
        <source>{points} points</source>
        <translation>{points} 个点</translation>
    </message>
    <message>
        <source>{rate:.1f} sets a second</source>
        <translation>每秒 {rate:.1f} 组</translation>
    </message>
    <message>
        <source>{ms:.0f} ms after the images</source>
        <translation>图像之后 {ms:.0f} 毫秒</translation>
    </message>
</context>
<context>
    <name>MeasurePage</name>
    <message>
        <source>Points</source>
        <translation>点</translation>
    </message>
    <message>
        <source>Points that are seen now</source>
        <translation>当前看到的点</translation>
    </message>
    <message>
        <source>Value</source>
        <translation>量</translation>
    </message>
    <message>
        <source>measured</source>
        <translation>测得</translation>
    </message>
    <message>
        <source>± (95 %)</source>
        <translation>±（95 %）</translation>
    </message>
    <message>
        <source>off its nominal value</source>
        <translation>与标称值之差</translation>
    </message>
    <message>
        <source>{sets} sets recorded in {folder}.</source>
        <translation>已记录 {sets} 组，位于 {folder}。</translation>
    </message>
</context>
<context>
    <name>Placement</name>
    <message>
        <source>Ready: {names} sees little here, but enough elsewhere</source>
        <translation>就绪：{names} 此处看到的点少，但其他位置已足够</translation>
    </message>
    <message>
        <source>Ready: press space</source>
        <translation>就绪：请按空格键</translation>
    </message>
    <message>
        <source>Fewer than {needed} dots: {cameras}. Capture anyway, or move the ball</source>
        <translation>圆点少于 {needed} 个：{cameras}。仍可拍摄，或移动球</translation>
    </message>
    <message>
        <source>all cameras</source>
        <translation>所有相机</translation>
    </message>
    <message>
        <source>Need them elsewhere in the image:</source>
        <translation>点需分布到图像其他区域：</translation>
    </message>
    <message>
        <source>At the next placements, fill other parts of the image:</source>
        <translation>后续摆放时请填满图像其他区域：</translation>
    </message>
    <message>
        <source>Need more dots:</source>
        <translation>需要更多点：</translation>
    </message>
    <message>
        <source>needs more dots</source>
        <translation>需要更多点</translation>
    </message>
    <message>
        <source>on the left</source>
        <translation>左侧</translation>
    </message>
    <message>
        <source>on the right</source>
        <translation>右侧</translation>
    </message>
    <message>
        <source>at the top</source>
        <translation>上方</translation>
    </message>
    <message>
        <source>at the bottom</source>
        <translation>下方</translation>
    </message>
    <message>
        <source>no dots {part}</source>
        <translation>{part}没有点</translation>
    </message>
    <message>
        <source>few dots {part}</source>
        <translation>{part}点很少</translation>
    </message>
    <message>
        <source>All cameras are linked.</source>
        <translation>所有相机都已关联。</translation>
    </message>
    <message>
        <source>Not linked with each other: {names}</source>
        <translation>彼此未关联：{names}</translation>
    </message>
    <message>
        <source>{name} is captured, but without {cameras}.</source>
        <translation>{name} 已拍摄，但缺少 {cameras}。</translation>
    </message>
    <message>
        <source>Check these cameras, then retake it.</source>
        <translation>请检查这些相机，然后重拍。</translation>
    </message>
    <message>
        <source>{name} is captured, but {cameras} saw it move.</source>
        <translation>{name} 已拍摄，但 {cameras} 看到其移动。</translation>
    </message>
    <message>
        <source>Let it come to rest, then retake it.</source>
        <translation>待其静止后重拍。</translation>
    </message>
    <message>
        <source>{name} is captured.</source>
        <translation>{name} 已拍摄。</translation>
    </message>
</context>
<context>
    <name>PlacementPage</name>
    <message>
        <source>How long it has lain still</source>
        <translation>已静止多久</translation>
    </message>
    <message>
        <source>Capture by itself when still</source>
        <translation>静止时自动拍摄</translation>
    </message>
    <message>
        <source>Mask the bright spots</source>
        <translation>遮挡亮斑</translation>
    </message>
    <message>
        <source>The outlined bright spots stay where they are when the ball moves: nothing in them counts.</source>
        <translation>移动球时，框出的亮斑保持不动：其中的内容不计入。</translation>
    </message>
    <message>
        <source>Leave the bright spots</source>
        <translation>保留亮斑</translation>
    </message>
    <message>
        <source>Retake</source>
        <translation>重拍</translation>
    </message>
    <message>
        <source>Delete</source>
        <translation>删除</translation>
    </message>
    <message>
        <source>Undo</source>
        <translation>撤销</translation>
    </message>
    <message>
        <source>One more placement</source>
        <translation>再增一次摆放</translation>
    </message>
    <message>
        <source>Expected error on 500 mm (95 %).</source>
        <translation>500 mm 上的预期误差（95 %）。</translation>
    </message>
    <message>
        <source>Enough: one more placement would not be worth it.</source>
        <translation>已足够：再多摆放一次没有明显好处。</translation>
    </message>
    <message>
        <source>It was turned</source>
        <translation>球已转动</translation>
    </message>
    <message>
        <source>The ball is in the same place, but shows another side.</source>
        <translation>球仍在原处，但朝向已改变。</translation>
    </message>
    <message>
        <source>Keep it as it is</source>
        <translation>保持现状</translation>
    </message>
    <message>
        <source>Fixed again</source>
        <translation>已重新固定</translation>
    </message>
    <message>
        <source>Once the ball lies still where it should.</source>
        <translation>球在应在的位置静止后。</translation>
    </message>
    <message>
        <source>The cameras that were moved are fixed: they count as they stand now.</source>
        <translation>被移动的相机已固定：以现在的位置为准。</translation>
    </message>
    <message>
        <source>A click on a camera shows its picture.</source>
        <translation>点击相机可显示其图像。</translation>
    </message>
    <message>
        <source>Green: covered so far. Blue: what this placement adds.</source>
        <translation>绿色：已覆盖。蓝色：本次摆放新增。</translation>
    </message>
    <message>
        <source>Coverage</source>
        <translation>覆盖</translation>
    </message>
    <message>
        <source>Dots that two cameras have in common, over all placements and this image.</source>
        <translation>两台相机在所有摆放及当前图像中的公共点数。</translation>
    </message>
    <message>
        <source>Pairs</source>
        <translation>相机对</translation>
    </message>
    <message>
        <source>Put it there</source>
        <translation>放到该处</translation>
    </message>
    <message>
        <source>Training: moves the simulated ball to where it should go.</source>
        <translation>练习：将仿真球移到应放的位置。</translation>
    </message>
    <message>
        <source>In space</source>
        <translation>三维</translation>
    </message>
    <message>
        <source>Skip this placement</source>
        <translation>跳过此次摆放</translation>
    </message>
    <message>
        <source>Undo {name}</source>
        <translation>撤销 {name}</translation>
    </message>
    <message>
        <source>Working out where the ball should go next: {seconds:.0f} s</source>
        <translation>正在计算球的下一个位置：{seconds:.0f} 秒</translation>
    </message>
</context>
<context>
    <name>Profile</name>
    <message>
        <source>not verified</source>
        <translation>未验证</translation>
    </message>
</context>
<context>
    <name>ProfileDialog</name>
    <message>
        <source>The rig&apos;s profile</source>
        <translation>系统档案</translation>
    </message>
    <message>
        <source>Number</source>
        <translation>编号</translation>
    </message>
    <message>
        <source>calibrated</source>
        <translation>标定时间</translation>
    </message>
    <message>
        <source>state</source>
        <translation>状态</translation>
    </message>
    <message>
        <source>verified</source>
        <translation>已验证</translation>
    </message>
    <message>
        <source>rms
px</source>
        <translation>rms
px</translation>
    </message>
    <message>
        <source>in use</source>
        <translation>启用中</translation>
    </message>
    <message>
        <source>Compare with the one in use</source>
        <translation>与启用中的标定比较</translation>
    </message>
    <message>
        <source>Put this one to use</source>
        <translation>启用此标定</translation>
    </message>
    <message>
        <source>Close</source>
        <translation>关闭</translation>
    </message>
    <message>
        <source>Choose one that is not in use.</source>
        <translation>请选择一个未启用的标定。</translation>
    </message>
    <message>
        <source>It was not verified, and the limits forbid its use.</source>
        <translation>未经验证，限值不允许启用。</translation>
    </message>
    <message>
        <source>Its verification failed: it cannot be put to use.</source>
        <translation>其验证未通过：不能投入使用。</translation>
    </message>
    <message>
        <source>It is not valid: it cannot be put to use.</source>
        <translation>该标定无效，不能启用。</translation>
    </message>
    <message>
        <source>It is in use already.</source>
        <translation>已启用。</translation>
    </message>
    <message>
        <source>It is to be used with care. Why may it be put to use?</source>
        <translation>它须谨慎使用。为什么可以启用？</translation>
    </message>
    <message>
        <source>Its verification failed. Why may it be put to use?</source>
        <translation>其验证未通过。为何可以投入使用？</translation>
    </message>
    <message>
        <source>It was not verified. Why may it be put to use?</source>
        <translation>它未经验证。为什么可以启用？</translation>
    </message>
    <message>
        <source>It was not put to use: a reason is needed.</source>
        <translation>未启用：需要填写理由。</translation>
    </message>
    <message>
        <source>Calibration {number} is in use now.</source>
        <translation>标定 {number} 现已启用。</translation>
    </message>
</context>
<context>
    <name>Rail</name>
    <message>
        <source>Steps</source>
        <translation>步骤</translation>
    </message>
</context>
<context>
    <name>ResidualView</name>
    <message>
        <source>Residuals of {name}</source>
        <translation>{name} 的残差</translation>
    </message>
    <message>
        <source>{px:.3f} px</source>
        <translation>{px:.3f} px</translation>
    </message>
    <message>
        <source>no residuals</source>
        <translation>无残差</translation>
    </message>
    <message>
        <source>Drawn {gain:.0f} times larger; most below {usual:.3f} px</source>
        <translation>放大 {gain:.0f} 倍；大多低于 {usual:.3f} px</translation>
    </message>
    <message>
        <source>; {out} left out</source>
        <translation>；略去 {out} 个</translation>
    </message>
</context>
<context>
    <name>Results</name>
    <message>
        <source>FAILED</source>
        <translation>失败</translation>
    </message>
    <message>
        <source>No camera could be placed.</source>
        <translation>没有相机能够定位。</translation>
    </message>
    <message>
        <source>{placed} of {all} cameras placed; the images agree to {rms:.3f} px.</source>
        <translation>{placed}/{all} 台相机已定位；图像一致性 {rms:.3f} px。</translation>
    </message>
    <message>
        <source>A length of {length:.0f} mm is measured to {mm:.3f} mm (95 %).</source>
        <translation>{length:.0f} mm 的长度可测准至 {mm:.3f} mm（95 %）。</translation>
    </message>
    <message>
        <source>NOT VALID</source>
        <translation>无效</translation>
    </message>
    <message>
        <source>With care: {what}.</source>
        <translation>谨慎使用：{what}。</translation>
    </message>
    <message>
        <source>USE WITH CARE</source>
        <translation>谨慎使用</translation>
    </message>
    <message>
        <source>VALID</source>
        <translation>有效</translation>
    </message>
    <message>
        <source>the scale</source>
        <translation>比例尺</translation>
    </message>
    <message>
        <source>a part of the volume</source>
        <translation>部分测量空间</translation>
    </message>
    <message>
        <source>Since calibration {number} of {made}:</source>
        <translation>自 {made} 的标定 {number} 以来：</translation>
    </message>
    <message>
        <source>lengths change by up to {mm:.3f} mm</source>
        <translation>长度变化最多 {mm:.3f} mm</translation>
    </message>
    <message>
        <source>{cameras} moved</source>
        <translation>{cameras} 已移动</translation>
    </message>
    <message>
        <source>no camera stands out</source>
        <translation>没有异常相机</translation>
    </message>
    <message>
        <source>Mean {mean:.3f} px, largest {most:.3f} px.</source>
        <translation>平均 {mean:.3f} px，最大 {most:.3f} px。</translation>
    </message>
    <message>
        <source>Mean {mean:.3f} px, largest {most:.3f} px; at the ball {mean_mm:.3f} and {most_mm:.3f} mm.</source>
        <translation>平均 {mean:.3f} px，最大 {most:.3f} px；在球处为 {mean_mm:.3f} 和 {most_mm:.3f} mm。</translation>
    </message>
    <message>
        <source>Show {name}</source>
        <translation>显示 {name}</translation>
    </message>
    <message>
        <source>Retake {name}</source>
        <translation>重拍 {name}</translation>
    </message>
    <message>
        <source>Add a placement</source>
        <translation>增加一次摆放</translation>
    </message>
    <message>
        <source>Calibrate again</source>
        <translation>重新标定</translation>
    </message>
    <message>
        <source>Go to the bench</source>
        <translation>转到器具</translation>
    </message>
    <message>
        <source>Exchange {cameras} at {place}</source>
        <translation>在 {place} 处交换 {cameras}</translation>
    </message>
    <message>
        <source>Exchange {place}</source>
        <translation>交换 {place}</translation>
    </message>
    <message>
        <source>Split {camera} from {place} on</source>
        <translation>自 {place} 起拆分 {camera}</translation>
    </message>
    <message>
        <source>Leave out {camera} at {place}</source>
        <translation>剔除 {place} 处的 {camera}</translation>
    </message>
    <message>
        <source>Leave out {name}</source>
        <translation>剔除 {name}</translation>
    </message>
</context>
<context>
    <name>ResultsPage</name>
    <message>
        <source>Camera</source>
        <translation>相机</translation>
    </message>
    <message>
        <source>rms
px</source>
        <translation>rms
px</translation>
    </message>
    <message>
        <source>dots</source>
        <translation>点数</translation>
    </message>
    <message>
        <source>left
out</source>
        <translation>剔除
数</translation>
    </message>
    <message>
        <source>place ±
mm</source>
        <translation>位置 ±
mm</translation>
    </message>
    <message>
        <source>turn ±
deg</source>
        <translation>转角 ±
度</translation>
    </message>
    <message>
        <source>focal
px</source>
        <translation>焦距
px</translation>
    </message>
    <message>
        <source>change
mm</source>
        <translation>变化
mm</translation>
    </message>
    <message>
        <source>What to do</source>
        <translation>处理建议</translation>
    </message>
    <message>
        <source>Cameras</source>
        <translation>相机</translation>
    </message>
    <message>
        <source>Residuals</source>
        <translation>残差</translation>
    </message>
    <message>
        <source>Which image</source>
        <translation>哪幅图像</translation>
    </message>
    <message>
        <source>Leave this image out</source>
        <translation>剔除此图像</translation>
    </message>
    <message>
        <source>Leave the camera out</source>
        <translation>剔除该相机</translation>
    </message>
    <message>
        <source>not placed</source>
        <translation>未定位</translation>
    </message>
    <message>
        <source>Lenses</source>
        <translation>镜头</translation>
    </message>
    <message>
        <source>{camera}: all images</source>
        <translation>{camera}：所有图像</translation>
    </message>
    <message>
        <source>It is already requested: calibrate again.</source>
        <translation>已提出要求：请重新标定。</translation>
    </message>
    <message>
        <source>Choose one image on the left first.</source>
        <translation>请先在左侧选择一幅图像。</translation>
    </message>
</context>
<context>
    <name>RigTab</name>
    <message>
        <source>Placements of the ball</source>
        <translation>球的摆放次数</translation>
    </message>
    <message>
        <source>Bars&apos; temperature (°C)</source>
        <translation>基准尺温度 (°C)</translation>
    </message>
    <message>
        <source>Read it on the day, on the bar itself; empty: not read.</source>
        <translation>当天在基准尺上读取；留空表示未读取。</translation>
    </message>
    <message>
        <source>Limits</source>
        <translation>限值</translation>
    </message>
    <message>
        <source>Open the limits</source>
        <translation>打开限值</translation>
    </message>
    <message>
        <source>Permitted length error: {limit} mm (L in mm).</source>
        <translation>允许的长度误差：{limit} mm（L 以 mm 计）。</translation>
    </message>
    <message>
        <source>No permitted length error is set: lengths are judged by their own uncertainty.</source>
        <translation>未设定允许的长度误差：按长度自身的不确定度判断。</translation>
    </message>
</context>
<context>
    <name>Save</name>
    <message>
        <source>The report is in {what}.</source>
        <translation>报告位于 {what}。</translation>
    </message>
    <message>
        <source>SIMULATED: no calibration of a real rig</source>
        <translation>仿真：不是真实系统的标定</translation>
    </message>
    <message>
        <source>The calibration in use was not changed. This one stays in {folder}.</source>
        <translation>启用中的标定保持不变。本次标定保留在 {folder}。</translation>
    </message>
    <message>
        <source>Saved in the rig&apos;s profile as calibration {what}.</source>
        <translation>已作为标定 {what} 存入系统档案。</translation>
    </message>
    <message>
        <source>Written to {what}.</source>
        <translation>已写入 {what}。</translation>
    </message>
</context>
<context>
    <name>SavePage</name>
    <message>
        <source>The rig&apos;s profile</source>
        <translation>系统档案</translation>
    </message>
    <message>
        <source>Keeps every calibration of this rig; the one in use changes only when you say so.</source>
        <translation>保存该系统的每次标定；只有经您同意才会更换启用的标定。</translation>
    </message>
    <message>
        <source>Put it to use now</source>
        <translation>立即启用</translation>
    </message>
    <message>
        <source>Save in the profile</source>
        <translation>存入档案</translation>
    </message>
    <message>
        <source>Note: by whom, and why</source>
        <translation>备注：操作人和原因</translation>
    </message>
    <message>
        <source>Discard</source>
        <translation>放弃</translation>
    </message>
    <message>
        <source>The calibration in use stays as it is; this one stays in its folder, and nothing is deleted.</source>
        <translation>启用中的标定保持不变；本次标定保留在其文件夹中，不会删除任何内容。</translation>
    </message>
    <message>
        <source>Its verification failed: it cannot be put to use. Find the cause, or save it without.</source>
        <translation>验证未通过：不能投入使用。请查找原因，或仅保存。</translation>
    </message>
    <message>
        <source>It was not verified, and the limits forbid its use: verify it, or save it without.</source>
        <translation>未经验证，限值不允许启用：请先验证，或只保存而不启用。</translation>
    </message>
    <message>
        <source>Its verification failed: write in the note why it is put to use all the same.</source>
        <translation>验证未通过：请在备注中写明为何仍投入使用。</translation>
    </message>
    <message>
        <source>Its verification decided nothing: write in the note why it is put to use.</source>
        <translation>验证未得出结论：请在备注中写明启用原因。</translation>
    </message>
    <message>
        <source>It was not verified: write in the note why it is put to use.</source>
        <translation>尚未验证：请在备注中写明启用原因。</translation>
    </message>
    <message>
        <source>It is to be used with care: write in the note why it is put to use.</source>
        <translation>需谨慎使用：请在备注中写明启用原因。</translation>
    </message>
    <message>
        <source>Its verification failed: it cannot be exported.</source>
        <translation>其验证未通过：不能导出。</translation>
    </message>
    <message>
        <source>There is no calibration yet.</source>
        <translation>尚无标定。</translation>
    </message>
    <message>
        <source>Files</source>
        <translation>文件</translation>
    </message>
    <message>
        <source>Open the folder</source>
        <translation>打开文件夹</translation>
    </message>
    <message>
        <source>Open the report</source>
        <translation>打开报告</translation>
    </message>
    <message>
        <source>Format of the export</source>
        <translation>导出格式</translation>
    </message>
    <message>
        <source>Export</source>
        <translation>导出</translation>
    </message>
    <message>
        <source>For another program:</source>
        <translation>用于其他程序：</translation>
    </message>
    <message>
        <source>Origin and axes</source>
        <translation>原点和坐标轴</translation>
    </message>
    <message>
        <source>The same on the command line</source>
        <translation>对应的命令行</translation>
    </message>
    <message>
        <source>Copy as command</source>
        <translation>复制为命令</translation>
    </message>
    <message>
        <source>A simulated rig has a profile of its own: it never counts as the calibration of a real one.</source>
        <translation>仿真系统有自己的档案：绝不会当作真实系统的标定。</translation>
    </message>
    <message>
        <source>Exports are given in: {frame}.</source>
        <translation>导出所用坐标系：{frame}。</translation>
    </message>
    <message>
        <source>Work is running.</source>
        <translation>正在运行。</translation>
    </message>
    <message>
        <source>The calibration is out of date.</source>
        <translation>标定已过期。</translation>
    </message>
    <message>
        <source>The calibration is not valid: it cannot be put to use. Save it without.</source>
        <translation>标定无效：不能启用。请只保存而不启用。</translation>
    </message>
    <message>
        <source>It is not written yet.</source>
        <translation>尚未写入。</translation>
    </message>
    <message>
        <source>In use: calibration {number}, in {folder}.</source>
        <translation>启用中：标定 {number}，位于 {folder}。</translation>
    </message>
    <message>
        <source>Report: {path}</source>
        <translation>报告：{path}</translation>
    </message>
    <message>
        <source>No program was found here that opens it: copy the file, or open it elsewhere.</source>
        <translation>本机没有可打开它的程序：请复制文件，或在别处打开。</translation>
    </message>
    <message>
        <source>Copied.</source>
        <translation>已复制。</translation>
    </message>
</context>
<context>
    <name>ScalePage</name>
    <message>
        <source>Retake the last pose</source>
        <translation>重拍上一位姿</translation>
    </message>
    <message>
        <source>Capture by itself when still</source>
        <translation>静止时自动拍摄</translation>
    </message>
    <message>
        <source>Once the bar was moved and lies still where three cameras see it.</source>
        <translation>杆移动过并静止在三台相机可见之处后。</translation>
    </message>
    <message>
        <source>No pose is captured yet.</source>
        <translation>尚未拍摄任何位姿。</translation>
    </message>
</context>
<context>
    <name>Scene</name>
    <message>
        <source>{length:.0f} mm at this place</source>
        <translation>此处的 {length:.0f} mm 长度</translation>
    </message>
    <message>
        <source>{placement}, target {target}, dot {dot}</source>
        <translation>{placement}，靶标 {target}，点 {dot}</translation>
    </message>
    <message>
        <source>Serial number {serial}</source>
        <translation>序列号 {serial}</translation>
    </message>
    <message>
        <source>Sensor {width} × {height} px</source>
        <translation>传感器 {width} × {height} px</translation>
    </message>
    <message>
        <source>Residuals {rms:.3f} px rms</source>
        <translation>残差 {rms:.3f} px rms</translation>
    </message>
    <message>
        <source>Place ± {sd:.3f} mm</source>
        <translation>位置 ± {sd:.3f} mm</translation>
    </message>
    <message>
        <source>Moved by {mm:.3f} mm and {deg:.3f}°</source>
        <translation>移动 {mm:.3f} mm，转动 {deg:.3f}°</translation>
    </message>
    <message>
        <source>Ball, radius {radius:.2f} mm</source>
        <translation>球，半径 {radius:.2f} mm</translation>
    </message>
    <message>
        <source>Length error {error:+.3f} mm</source>
        <translation>长度误差 {error:+.3f} mm</translation>
    </message>
    <message>
        <source>Uncertainty {u:.3f} mm (95 %)</source>
        <translation>不确定度 {u:.3f} mm（95 %）</translation>
    </message>
    <message>
        <source>Residual {px:.3f} px rms</source>
        <translation>残差 {px:.3f} px rms</translation>
    </message>
    <message>
        <source>Ellipsoids: 1 σ × {factor}</source>
        <translation>椭球：1 σ × {factor}</translation>
    </message>
    <message>
        <source>Yellow: before, way × {factor}</source>
        <translation>黄色：移动前，位移 × {factor}</translation>
    </message>
    <message>
        <source>Bars: green within their uncertainty, red beyond</source>
        <translation>基准尺：绿色在不确定度内，红色超出</translation>
    </message>
    <message>
        <source>Uncertainty of {length:.0f} mm, mm (95 %)</source>
        <translation>{length:.0f} mm 的不确定度，mm（95 %）</translation>
    </message>
    <message>
        <source>Residuals of the dots, px</source>
        <translation>点的残差，px</translation>
    </message>
</context>
<context>
    <name>ScenePanel</name>
    <message>
        <source>Show</source>
        <translation>显示</translation>
    </message>
    <message>
        <source>Dots by their residuals</source>
        <translation>按残差着色的点</translation>
    </message>
    <message>
        <source>Images of the cameras</source>
        <translation>相机图像</translation>
    </message>
    <message>
        <source>Uncertainty of a length</source>
        <translation>长度的不确定度</translation>
    </message>
    <message>
        <source>Ellipsoids of uncertainty</source>
        <translation>不确定度椭球</translation>
    </message>
    <message>
        <source>Paths</source>
        <translation>路径</translation>
    </message>
    <message>
        <source>Show all</source>
        <translation>显示全部</translation>
    </message>
    <message>
        <source>Save</source>
        <translation>保存</translation>
    </message>
    <message>
        <source>As a picture (PNG)</source>
        <translation>保存为图片 (PNG)</translation>
    </message>
    <message>
        <source>As a 3-D model (glTF)</source>
        <translation>保存为三维模型 (glTF)</translation>
    </message>
    <message>
        <source>Save the picture</source>
        <translation>保存图片</translation>
    </message>
    <message>
        <source>Save the 3-D model</source>
        <translation>保存三维模型</translation>
    </message>
    <message>
        <source>{path} could not be written.</source>
        <translation>无法写入 {path}。</translation>
    </message>
    <message>
        <source>Saved: {path}</source>
        <translation>已保存：{path}</translation>
    </message>
</context>
<context>
    <name>SceneView</name>
    <message>
        <source>The rig with its cameras {names}</source>
        <translation>系统及其相机 {names}</translation>
    </message>
</context>
<context>
    <name>Sounds</name>
    <message>
        <source>There is no program that plays sounds; one of these is needed: {names}.</source>
        <translation>没有可播放声音的程序；需要其中之一：{names}。</translation>
    </message>
    <message>
        <source>The sound device does not work: {why}. Choose one in the system&apos;s settings.</source>
        <translation>声音设备无法工作：{why}。请在系统设置中选择一个。</translation>
    </message>
</context>
<context>
    <name>Source</name>
    <message>
        <source>SIMULATED</source>
        <translation>仿真</translation>
    </message>
    <message>
        <source>REPLAY</source>
        <translation>回放</translation>
    </message>
    <message>
        <source>LIVE</source>
        <translation>实时</translation>
    </message>
</context>
<context>
    <name>Start</name>
    <message>
        <source>verified</source>
        <translation>已验证</translation>
    </message>
    <message>
        <source>the check bar contradicts it</source>
        <translation>检验尺与其矛盾</translation>
    </message>
    <message>
        <source>calibrated, not valid</source>
        <translation>已标定，无效</translation>
    </message>
    <message>
        <source>calibrated, not verified</source>
        <translation>已标定，未验证</translation>
    </message>
    <message>
        <source>{taken} of {planned} placements captured</source>
        <translation>已拍摄 {taken}/{planned} 次摆放</translation>
    </message>
    <message>
        <source>verified, undecided</source>
        <translation>已验证，未判定</translation>
    </message>
    <message>
        <source>check begun</source>
        <translation>检查已开始</translation>
    </message>
    <message>
        <source>checked: {verdict}</source>
        <translation>已检查：{verdict}</translation>
    </message>
    <message>
        <source>Check the rig again by {at}.</source>
        <translation>请在 {at} 之前再次检查系统。</translation>
    </message>
    <message>
        <source>Calibration {number}, verified {at}: {verdict}</source>
        <translation>标定 {number}，{at} 验证：{verdict}</translation>
    </message>
    <message>
        <source>Calibration {number}, not verified yet</source>
        <translation>标定 {number}，尚未验证</translation>
    </message>
    <message>
        <source>Calibration {number}: {verdict}</source>
        <translation>标定 {number}：{verdict}</translation>
    </message>
    <message>
        <source>Calibrated {minutes} minutes ago</source>
        <translation>{minutes} 分钟前标定</translation>
    </message>
    <message>
        <source>Calibrated {hours} hours ago</source>
        <translation>{hours} 小时前标定</translation>
    </message>
    <message>
        <source>Calibrated {days} days ago</source>
        <translation>{days} 天前标定</translation>
    </message>
</context>
<context>
    <name>StartPage</name>
    <message>
        <source>Open another folder</source>
        <translation>打开其他文件夹</translation>
    </message>
    <message>
        <source>Check</source>
        <translation>检查</translation>
    </message>
    <message>
        <source>no calibration in use</source>
        <translation>没有启用中的标定</translation>
    </message>
    <message>
        <source>The rig&apos;s profile</source>
        <translation>系统档案</translation>
    </message>
    <message>
        <source>Rig in use</source>
        <translation>启用中的系统</translation>
    </message>
    <message>
        <source>Check the rig</source>
        <translation>检查系统</translation>
    </message>
    <message>
        <source>Calibrate</source>
        <translation>标定</translation>
    </message>
    <message>
        <source>A new calibration of the whole rig, from the cameras to the report.</source>
        <translation>从相机到报告，对整个系统重新标定。</translation>
    </message>
    <message>
        <source>Recent</source>
        <translation>最近</translation>
    </message>
    <message>
        <source>Replay a recorded session</source>
        <translation>回放已采集的会话</translation>
    </message>
    <message>
        <source>Calibrate the rig</source>
        <translation>标定系统</translation>
    </message>
    <message>
        <source>Verify</source>
        <translation>验证</translation>
    </message>
    <message>
        <source>Bench, bars and balls</source>
        <translation>器具、基准尺和球</translation>
    </message>
    <message>
        <source>Verify the rig</source>
        <translation>验证系统</translation>
    </message>
    <message>
        <source>Has a camera moved since? One minute, one placement of the ball.</source>
        <translation>此后是否有相机移动？一分钟，摆放一次球。</translation>
    </message>
    <message>
        <source>Does the rig measure right? The check bar is measured, and the result printed.</source>
        <translation>装置测量是否正确？测量检验杆并打印结果。</translation>
    </message>
    <message>
        <source>Train on a simulated rig</source>
        <translation>在仿真系统上练习</translation>
    </message>
    <message>
        <source>Nothing yet. Projects are kept in {folder}.</source>
        <translation>暂无。项目保存在 {folder}。</translation>
    </message>
    <message>
        <source>Save a calibration in the rig&apos;s profile; then it can be checked.</source>
        <translation>先将标定存入系统档案，然后即可检查。</translation>
    </message>
    <message>
        <source>No calibration is in use yet: calibrate, then save it in the rig&apos;s profile.</source>
        <translation>尚无启用中的标定：请先标定，再存入系统档案。</translation>
    </message>
    <message>
        <source>Open a project</source>
        <translation>打开项目</translation>
    </message>
    <message>
        <source>A recorded session with images</source>
        <translation>带图像的已采集会话</translation>
    </message>
    <message>
        <source>No calibration was saved in the rig&apos;s profile yet.</source>
        <translation>系统档案中尚无标定。</translation>
    </message>
    <message>
        <source>Calibrate with a board</source>
        <translation>用标定板标定</translation>
    </message>
    <message>
        <source>ChArUco, AprilGrid, chessboard or circles; no ball is needed.</source>
        <translation>ChArUco、AprilGrid、棋盘格或圆点；不需要球。</translation>
    </message>
</context>
<context>
    <name>State</name>
    <message>
        <source>Work is running.</source>
        <translation>正在运行。</translation>
    </message>
    <message>
        <source>The cameras are not connected.</source>
        <translation>相机未连接。</translation>
    </message>
    <message>
        <source>The cameras are being looked for.</source>
        <translation>正在查找相机。</translation>
    </message>
    <message>
        <source>There are no cameras yet.</source>
        <translation>尚无相机。</translation>
    </message>
    <message>
        <source>It was confirmed already.</source>
        <translation>已确认。</translation>
    </message>
    <message>
        <source>Bench confirmed</source>
        <translation>器具已确认</translation>
    </message>
    <message>
        <source>Yes, this matches</source>
        <translation>是，一致</translation>
    </message>
    <message>
        <source>{cameras}. What is on the bench?</source>
        <translation>{cameras}。台上放的是什么？</translation>
    </message>
    <message>
        <source>Describe the bench</source>
        <translation>描述器具</translation>
    </message>
    <message>
        <source>{cameras}. Is this on the bench?</source>
        <translation>{cameras}。台上放的是这些吗？</translation>
    </message>
    <message>
        <source>The images are good</source>
        <translation>图像良好</translation>
    </message>
    <message>
        <source>Use the images as they are</source>
        <translation>按现状使用图像</translation>
    </message>
    <message>
        <source>They were accepted already.</source>
        <translation>已接受。</translation>
    </message>
    <message>
        <source>See to the cameras that are named above.</source>
        <translation>请检查上面列出的相机。</translation>
    </message>
    <message>
        <source>Targets are being looked for. On a new computer the first time takes a minute or two.</source>
        <translation>正在查找靶标。在新电脑上首次需要一两分钟。</translation>
    </message>
    <message>
        <source>Not every camera has sent an image yet.</source>
        <translation>尚有相机未传来图像。</translation>
    </message>
    <message>
        <source>Next, once this is captured.</source>
        <translation>拍摄之后可继续。</translation>
    </message>
    <message>
        <source>Next, once this is captured or skipped.</source>
        <translation>拍摄或跳过之后可继续。</translation>
    </message>
    <message>
        <source>Capture  (space)</source>
        <translation>拍摄（空格键）</translation>
    </message>
    <message>
        <source>Capture without {cameras}</source>
        <translation>不用 {cameras} 拍摄</translation>
    </message>
    <message>
        <source>Capture anyway  (space)</source>
        <translation>仍然拍摄（空格键）</translation>
    </message>
    <message>
        <source>Capturing</source>
        <translation>正在拍摄</translation>
    </message>
    <message>
        <source>Retake  (space)</source>
        <translation>重拍（空格键）</translation>
    </message>
    <message>
        <source>Go on without {cameras}</source>
        <translation>不用 {cameras} 继续</translation>
    </message>
    <message>
        <source>Captured</source>
        <translation>已拍摄</translation>
    </message>
    <message>
        <source>Images are being captured.</source>
        <translation>正在拍摄。</translation>
    </message>
    <message>
        <source>The dots are being found in the images; the ball may be moved already.</source>
        <translation>正在图像中寻找圆点；球已可移动。</translation>
    </message>
    <message>
        <source>Turn or move the ball: {names} sees too little</source>
        <translation>请转动或移动球：{names} 看到的太少</translation>
    </message>
    <message>
        <source>Hold still: images are being captured</source>
        <translation>请保持静止：正在拍摄</translation>
    </message>
    <message>
        <source>The images are there; their dots are being found</source>
        <translation>图像已拍好；正在寻找圆点</translation>
    </message>
    <message>
        <source>Retake it, or keep it as it is</source>
        <translation>请重拍，或按现状保留</translation>
    </message>
    <message>
        <source>Captured. Press space to go on</source>
        <translation>已拍摄。按空格键继续</translation>
    </message>
    <message>
        <source>The recording shows no targets here</source>
        <translation>录制内容在此没有显示标志</translation>
    </message>
    <message>
        <source>Recorded images. Press space to take them over</source>
        <translation>录制的图像。按空格键采用</translation>
    </message>
    <message>
        <source>Put the ball where the cameras see it</source>
        <translation>把球放到相机可见之处</translation>
    </message>
    <message>
        <source>Move the ball, or confirm that it was turned</source>
        <translation>请移动球，或确认球已转动</translation>
    </message>
    <message>
        <source>Checking that the ball is still</source>
        <translation>正在确认球是否静止</translation>
    </message>
    <message>
        <source>Let the ball come to rest</source>
        <translation>让球静止下来</translation>
    </message>
    <message>
        <source>Move the board: elsewhere, and tilted otherwise</source>
        <translation>移动标定板：换个位置，换个倾角</translation>
    </message>
    <message>
        <source>Show the board to the cameras</source>
        <translation>把标定板展示给相机</translation>
    </message>
    <message>
        <source>Checking that the board is still</source>
        <translation>正在检查标定板是否静止</translation>
    </message>
    <message>
        <source>Hold the board still</source>
        <translation>保持标定板静止</translation>
    </message>
    <message>
        <source>Leave the ball where it is</source>
        <translation>球保持原位</translation>
    </message>
    <message>
        <source>Move the ball {up:.0f} mm down</source>
        <translation>将球降低 {up:.0f} mm</translation>
    </message>
    <message>
        <source>Move the ball {up:.0f} mm up</source>
        <translation>将球升高 {up:.0f} mm</translation>
    </message>
    <message>
        <source>Move the ball {away:.0f} mm towards {camera}</source>
        <translation>将球向 {camera} 移动 {away:.0f} mm</translation>
    </message>
    <message>
        <source>Move the ball {away:.0f} mm towards {camera} and {up:.0f} mm up</source>
        <translation>将球向 {camera} 移动 {away:.0f} mm 并升高 {up:.0f} mm</translation>
    </message>
    <message>
        <source>Move the ball {away:.0f} mm towards {camera} and {up:.0f} mm down</source>
        <translation>将球向 {camera} 移动 {away:.0f} mm 并降低 {up:.0f} mm</translation>
    </message>
    <message>
        <source>tip its top {turn:.0f}° towards {camera}</source>
        <translation>顶部朝 {camera} 倾转 {turn:.0f}°</translation>
    </message>
    <message>
        <source>turn it {turn:.0f}° to the left, as on a turntable</source>
        <translation>像转盘一样向左转 {turn:.0f}°</translation>
    </message>
    <message>
        <source>turn it {turn:.0f}° to the right, as on a turntable</source>
        <translation>像转盘一样向右转 {turn:.0f}°</translation>
    </message>
    <message>
        <source>{place}, {turn}</source>
        <translation>{place}，{turn}</translation>
    </message>
    <message>
        <source>All poses are captured</source>
        <translation>所有姿态均已拍摄</translation>
    </message>
    <message>
        <source>The recording shows no bar here</source>
        <translation>录制内容在此没有显示杆</translation>
    </message>
    <message>
        <source>Lay the bar where two cameras or more see it</source>
        <translation>将基准尺放在至少两台相机可见之处</translation>
    </message>
    <message>
        <source>Only two cameras see the bar; three are better</source>
        <translation>仅两台相机看到基准尺；三台更好</translation>
    </message>
    <message>
        <source>Ready: press space</source>
        <translation>就绪：请按空格键</translation>
    </message>
    <message>
        <source>All poses captured</source>
        <translation>所有位姿已拍摄</translation>
    </message>
    <message>
        <source>Measure the bar</source>
        <translation>测量基准尺</translation>
    </message>
    <message>
        <source>Measuring</source>
        <translation>正在测量</translation>
    </message>
    <message>
        <source>Lengths are being measured.</source>
        <translation>正在测量长度。</translation>
    </message>
    <message>
        <source>It is measured; retake a pose to measure again.</source>
        <translation>已测量；重拍某位姿后可再次测量。</translation>
    </message>
    <message>
        <source>Calibrate</source>
        <translation>标定</translation>
    </message>
    <message>
        <source>The last stage is coming to its end.</source>
        <translation>最后阶段即将结束。</translation>
    </message>
    <message>
        <source>Stopping</source>
        <translation>正在停止</translation>
    </message>
    <message>
        <source>Stopping: what was captured is kept</source>
        <translation>正在停止：已拍摄的内容保留</translation>
    </message>
    <message>
        <source>Computing</source>
        <translation>正在计算</translation>
    </message>
    <message>
        <source>Stopping as soon as there is a result</source>
        <translation>一有结果就停止</translation>
    </message>
    <message>
        <source>Cancel</source>
        <translation>取消</translation>
    </message>
    <message>
        <source>Ready: {taken} of {planned} placements</source>
        <translation>就绪：{taken}/{planned} 次摆放</translation>
    </message>
    <message>
        <source>It failed; what was captured is kept</source>
        <translation>失败；已拍摄的内容保留</translation>
    </message>
    <message>
        <source>Done: the calibration is valid</source>
        <translation>完成：标定有效</translation>
    </message>
    <message>
        <source>Done: the calibration is to be used with care</source>
        <translation>完成：标定需谨慎使用</translation>
    </message>
    <message>
        <source>See what to do</source>
        <translation>查看应如何处理</translation>
    </message>
    <message>
        <source>Done: the calibration is not valid</source>
        <translation>完成：标定无效</translation>
    </message>
    <message>
        <source>Accept the result</source>
        <translation>接受结果</translation>
    </message>
    <message>
        <source>Reading the result</source>
        <translation>正在读取结果</translation>
    </message>
    <message>
        <source>The result is being read.</source>
        <translation>正在读取结果。</translation>
    </message>
    <message>
        <source>A calibration is running: wait for what comes of it.</source>
        <translation>正在标定：请等待结果。</translation>
    </message>
    <message>
        <source>Being computed again</source>
        <translation>正在重新计算</translation>
    </message>
    <message>
        <source>Calibrate again</source>
        <translation>重新标定</translation>
    </message>
    <message>
        <source>OUT OF DATE</source>
        <translation>已过期</translation>
    </message>
    <message>
        <source>It was accepted already.</source>
        <translation>已接受。</translation>
    </message>
    <message>
        <source>It is not valid: do what the findings advise.</source>
        <translation>无效：请按检查结果建议处理。</translation>
    </message>
    <message>
        <source>It was asked to stop.</source>
        <translation>已要求停止。</translation>
    </message>
    <message>
        <source>Write the report</source>
        <translation>生成报告</translation>
    </message>
    <message>
        <source>See what has changed</source>
        <translation>查看变更</translation>
    </message>
    <message>
        <source>Save and put to use</source>
        <translation>保存并启用</translation>
    </message>
    <message>
        <source>Save in the profile</source>
        <translation>存入档案</translation>
    </message>
    <message>
        <source>Finish</source>
        <translation>完成</translation>
    </message>
    <message>
        <source>Writing</source>
        <translation>正在写入</translation>
    </message>
    <message>
        <source>The calibration is not saved yet</source>
        <translation>标定尚未保存</translation>
    </message>
    <message>
        <source>What was saved is out of date</source>
        <translation>已保存的内容已过期</translation>
    </message>
    <message>
        <source>Not saved yet; its verification failed</source>
        <translation>尚未保存；验证未通过</translation>
    </message>
    <message>
        <source>Not saved yet</source>
        <translation>尚未保存</translation>
    </message>
    <message>
        <source>Not saved yet; its verification decided nothing</source>
        <translation>尚未保存；验证未得出结论</translation>
    </message>
    <message>
        <source>Not saved yet; not verified</source>
        <translation>尚未保存；未验证</translation>
    </message>
    <message>
        <source>Saved; it is not valid</source>
        <translation>已保存；无效</translation>
    </message>
    <message>
        <source>Saved; its verification failed</source>
        <translation>已保存；验证未通过</translation>
    </message>
    <message>
        <source>Saved; its verification decided nothing</source>
        <translation>已保存；验证未得出结论</translation>
    </message>
    <message>
        <source>Saved; not verified</source>
        <translation>已保存；未验证</translation>
    </message>
    <message>
        <source>Saved; to be used with care</source>
        <translation>已保存；请谨慎使用</translation>
    </message>
    <message>
        <source>Saved</source>
        <translation>已保存</translation>
    </message>
    <message>
        <source>Checking</source>
        <translation>正在检查</translation>
    </message>
    <message>
        <source>Check</source>
        <translation>检查</translation>
    </message>
    <message>
        <source>Not done</source>
        <translation>未完成</translation>
    </message>
    <message>
        <source>Check again</source>
        <translation>再次检查</translation>
    </message>
    <message>
        <source>Put the repair to use</source>
        <translation>启用修复</translation>
    </message>
    <message>
        <source>Ready</source>
        <translation>就绪</translation>
    </message>
    <message>
        <source>Recording: {sets} sets</source>
        <translation>正在记录：{sets} 组</translation>
    </message>
    <message>
        <source>Stop recording</source>
        <translation>停止记录</translation>
    </message>
    <message>
        <source>Nothing is measured now.</source>
        <translation>当前没有测量。</translation>
    </message>
    <message>
        <source>Record</source>
        <translation>记录</translation>
    </message>
    <message>
        <source>{seconds:.0f} s, longer than usual ({usual:.0f} s)</source>
        <translation>{seconds:.0f} 秒，比平时长（{usual:.0f} 秒）</translation>
    </message>
    <message>
        <source>{seconds:.0f} s</source>
        <translation>{seconds:.0f} 秒</translation>
    </message>
    <message>
        <source>{gone}, nearly done</source>
        <translation>{gone}，即将完成</translation>
    </message>
    <message>
        <source>{gone}, about {left} s left</source>
        <translation>{gone}，约剩 {left} 秒</translation>
    </message>
    <message>
        <source>{gone}, about {left} min left</source>
        <translation>{gone}，约剩 {left} 分钟</translation>
    </message>
</context>
<context>
    <name>Tile</name>
    <message>
        <source>{name}, serial {serial}, exposure {ms:g} ms. Double click to enlarge, again to go back.</source>
        <translation>{name}，序列号 {serial}，曝光 {ms:g} ms。双击放大，再次双击返回。</translation>
    </message>
</context>
<context>
    <name>Validity</name>
    <message>
        <source>no calibration in use</source>
        <translation>没有启用中的标定</translation>
    </message>
    <message>
        <source>profile cannot be read</source>
        <translation>档案无法读取</translation>
    </message>
    <message>
        <source>Calibration {number} of {made}</source>
        <translation>标定 {number}，{made}</translation>
    </message>
    <message>
        <source>{minutes} min old</source>
        <translation>{minutes} 分钟前</translation>
    </message>
    <message>
        <source>{hours} h old</source>
        <translation>{hours} 小时前</translation>
    </message>
    <message>
        <source>{days} days old</source>
        <translation>{days} 天前</translation>
    </message>
    <message>
        <source>check: recalibrate</source>
        <translation>检查：需重新标定</translation>
    </message>
    <message>
        <source>check: watch it</source>
        <translation>检查：请留意</translation>
    </message>
    <message>
        <source>calibration fresh</source>
        <translation>标定较新</translation>
    </message>
    <message>
        <source>calibration ageing</source>
        <translation>标定渐旧</translation>
    </message>
    <message>
        <source>calibration out of date</source>
        <translation>标定已过期</translation>
    </message>
    <message>
        <source>calibration not valid</source>
        <translation>标定无效</translation>
    </message>
    <message>
        <source>calibration not verified</source>
        <translation>标定未验证</translation>
    </message>
    <message>
        <source>verification undecided</source>
        <translation>验证未判定</translation>
    </message>
    <message>
        <source>the check bar contradicts it</source>
        <translation>检验尺与其不符</translation>
    </message>
    <message>
        <source>to be used with care</source>
        <translation>请谨慎使用</translation>
    </message>
</context>
<context>
    <name>VerificationView</name>
    <message>
        <source>Errors</source>
        <translation>误差</translation>
    </message>
    <message>
        <source>In space</source>
        <translation>三维</translation>
    </message>
    <message>
        <source>Length</source>
        <translation>长度</translation>
    </message>
    <message>
        <source>n</source>
        <translation>n</translation>
    </message>
    <message>
        <source>sd, mm</source>
        <translation>标准差，mm</translation>
    </message>
    <message>
        <source>largest, mm</source>
        <translation>最大，mm</translation>
    </message>
    <message>
        <source>mean error, mm</source>
        <translation>平均误差，mm</translation>
    </message>
    <message>
        <source>±, mm</source>
        <translation>±，mm</translation>
    </message>
    <message>
        <source>limit, mm</source>
        <translation>限值，mm</translation>
    </message>
    <message>
        <source>decision</source>
        <translation>判定</translation>
    </message>
    <message>
        <source>contribution</source>
        <translation>分量</translation>
    </message>
    <message>
        <source>u, mm</source>
        <translation>u，mm</translation>
    </message>
    <message>
        <source>share</source>
        <translation>占比</translation>
    </message>
    <message>
        <source>what would help most</source>
        <translation>最有效的改进</translation>
    </message>
    <message>
        <source>Camera</source>
        <translation>相机</translation>
    </message>
    <message>
        <source>views of marks</source>
        <translation>标记观测数</translation>
    </message>
    <message>
        <source>used</source>
        <translation>已用</translation>
    </message>
    <message>
        <source>rms, px</source>
        <translation>rms，px</translation>
    </message>
    <message>
        <source>state</source>
        <translation>状态</translation>
    </message>
    <message>
        <source>Lengths</source>
        <translation>长度</translation>
    </message>
    <message>
        <source>Cameras</source>
        <translation>相机</translation>
    </message>
    <message>
        <source>Budget</source>
        <translation>不确定度预算</translation>
    </message>
    <message>
        <source>(out of date)</source>
        <translation>（已过期）</translation>
    </message>
</context>
<context>
    <name>Verify</name>
    <message>
        <source>{count} lengths, mean error {mean:+.3f} mm, largest {most:.3f} mm.</source>
        <translation>{count} 个长度，平均误差 {mean:+.3f} mm，最大 {most:.3f} mm。</translation>
    </message>
    <message>
        <source>Not verified, since they saw no mark: {cameras}.</source>
        <translation>未看到标记，未经验证：{cameras}。</translation>
    </message>
    <message>
        <source>Not where the calibration has them: {cameras}.</source>
        <translation>位置与标定不符：{cameras}。</translation>
    </message>
    <message>
        <source>Used all the same by {by}: {reason}</source>
        <translation>由 {by} 负责继续使用：{reason}</translation>
    </message>
    <message>
        <source>INCONSISTENT</source>
        <translation>不一致</translation>
    </message>
    <message>
        <source>The uncertainty is too large for the limit: “Budget” says what helps most.</source>
        <translation>对该限值来说不确定度太大：“不确定度预算”说明什么最有帮助。</translation>
    </message>
    <message>
        <source>UNDECIDED</source>
        <translation>未判定</translation>
    </message>
    <message>
        <source>PASS</source>
        <translation>合格</translation>
    </message>
    <message>
        <source>FAIL</source>
        <translation>不合格</translation>
    </message>
    <message>
        <source>CONSISTENT</source>
        <translation>一致</translation>
    </message>
    <message>
        <source>No captured pose shows two marks of the bar to two cameras: capture them again.</source>
        <translation>已拍摄的位姿中，没有一个让两台相机看到基准尺的两个标记：请重新拍摄。</translation>
    </message>
    <message>
        <source>NO DATA</source>
        <translation>无数据</translation>
    </message>
    <message>
        <source>The verification is finished: {verdict}.</source>
        <translation>验证完成：{verdict}。</translation>
    </message>
    <message>
        <source>Grey: what the uncertainty of each error allows.</source>
        <translation>灰色：各误差的不确定度所允许的范围。</translation>
    </message>
    <message>
        <source>Red lines: the limit {limit}; amber: its guard band. Decided by ISO 14253-1.</source>
        <translation>红线：限值 {limit}；黄色：保护带。按 ISO 14253-1 判定。</translation>
    </message>
    <message>
        <source>all together (k = {k:.1f}: U = {u:.3f} mm)</source>
        <translation>合计（k = {k:.1f}：U = {u:.3f} mm）</translation>
    </message>
</context>
<context>
    <name>VerifyPage</name>
    <message>
        <source>Locked: the responsible person sets this limit (Menu, Limits).</source>
        <translation>已锁定：此限值由负责人设定（菜单 → 限值）。</translation>
    </message>
    <message>
        <source>In space</source>
        <translation>三维</translation>
    </message>
    <message>
        <source>Images</source>
        <translation>图像</translation>
    </message>
    <message>
        <source>Capture by itself when it lies right</source>
        <translation>放正后自动拍摄</translation>
    </message>
    <message>
        <source>Capture it as it lies</source>
        <translation>按现状拍摄</translation>
    </message>
    <message>
        <source>Enough: measure now</source>
        <translation>足够了：现在测量</translation>
    </message>
    <message>
        <source>More poses</source>
        <translation>更多位姿</translation>
    </message>
    <message>
        <source>Permitted length error (mm)</source>
        <translation>允许的长度误差（mm）</translation>
    </message>
    <message>
        <source>e.g. 0.03+L/20000</source>
        <translation>例如 0.03+L/20000</translation>
    </message>
    <message>
        <source>Limit of the length errors: A + L/K in mm</source>
        <translation>长度误差限值：A + L/K，单位 mm</translation>
    </message>
    <message>
        <source>The largest error that is allowed, such as 0.03+L/20000; empty: judged by its own uncertainty.</source>
        <translation>允许的最大误差，例如 0.03+L/20000；留空则按自身不确定度判定。</translation>
    </message>
    <message>
        <source>not read</source>
        <translation>未读取</translation>
    </message>
    <message>
        <source>Temperature of the bar</source>
        <translation>基准尺温度</translation>
    </message>
    <message>
        <source>Read it on the bar: a steel bar of 500 mm grows by 0.006 mm for each degree.</source>
        <translation>请在尺上读取：500 mm 钢尺每升高一度伸长 0.006 mm。</translation>
    </message>
    <message>
        <source>Bar</source>
        <translation>基准尺</translation>
    </message>
    <message>
        <source>Captured; a click retakes it.</source>
        <translation>已拍摄；点击可重拍。</translation>
    </message>
    <message>
        <source>Not captured yet.</source>
        <translation>尚未拍摄。</translation>
    </message>
    <message>
        <source>No pose is captured yet.</source>
        <translation>尚未拍摄任何位姿。</translation>
    </message>
</context>
<context>
    <name>Wall</name>
    <message>
        <source>All cameras  (Esc)</source>
        <translation>全部相机（Esc）</translation>
    </message>
</context>
<context>
    <name>WindowFrame</name>
    <message>
        <source>Log</source>
        <translation>日志</translation>
    </message>
    <message>
        <source>Preparing computations: {percent} %</source>
        <translation>正在准备计算：{percent} %</translation>
    </message>
    <message>
        <source>Once after the installation, while the computer has time. Everything works already.</source>
        <translation>安装后进行一次，利用计算机空闲时间。所有功能已可使用。</translation>
    </message>
</context>
<context>
    <name>WizardWindow</name>
    <message>
        <source>Work is running; wait for it or cancel it.</source>
        <translation>正在运行；请等待或取消。</translation>
    </message>
    <message>
        <source>Imported. Assumed: {what}.</source>
        <translation>已导入。假定：{what}。</translation>
    </message>
    <message>
        <source>There is no command yet: calibrate first.</source>
        <translation>还没有命令：请先标定。</translation>
    </message>
    <message>
        <source>Copied.</source>
        <translation>已复制。</translation>
    </message>
    <message>
        <source>A sound was played. Was it heard?</source>
        <translation>已播放声音。听到了吗？</translation>
    </message>
    <message>
        <source>Opening</source>
        <translation>正在打开</translation>
    </message>
    <message>
        <source>not connected</source>
        <translation>未连接</translation>
    </message>
    <message>
        <source>{count} cameras</source>
        <translation>{count} 台相机</translation>
    </message>
    <message>
        <source>without {cameras}</source>
        <translation>缺少 {cameras}</translation>
    </message>
    <message>
        <source>connecting</source>
        <translation>正在连接</translation>
    </message>
    <message>
        <source>The support bundle is in {path}. It contains no images.</source>
        <translation>支持包位于 {path}，不含图像。</translation>
    </message>
    <message>
        <source>The computation is still stopping; close the window again in a moment.</source>
        <translation>计算正在停止；请稍后再关闭窗口。</translation>
    </message>
</context>
</TS>
