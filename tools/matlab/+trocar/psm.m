classdef psm < trocar.arm
    % An arm with an instrument: trocar.psm('PSM1'), see trocar.arm.

    properties (SetAccess = protected)
        jaw  % of the instrument
    end

    methods

        function self = psm(name, varargin)
            % trocar:argument when it is no PSM.
            self@trocar.arm(name, varargin{:});
            self.must_be('PSM');
            self.jaw = trocar.jaw(self.bridge, name);
        end

        function handle = insert_jp(self, depth)
            % Move the insertion (m) alone; the other joints go to their present setpoints.
            jp = self.setpoint_jp();
            jp(3) = depth;
            handle = self.move_jp(jp);
        end

        function name = tool(self)
            % The instrument as NAME:MODEL[VERSION]; empty: none is known to be on.
            row = self.state();
            name = row.tool;
        end

        function set_tool_type(self, name)
            % Say which instrument is on, NAME:MODEL.
            self.bridge.command(self.name, 'set_tool_type', [], name);
        end

        function emulate_tool_present(self, present)
            % Act as if an instrument were on; false: its switch counts again.
            self.command('emulate_tool_present', trocar.internal.flag(present));
        end

        function set_tool_present(self, present)
            % The same, as dvrk_matlab calls it.
            self.emulate_tool_present(present);
        end

        function emulate_adapter_present(self, present)
            % Act as if a sterile adapter were on; false: its switch counts again.
            self.command('emulate_adapter_present', trocar.internal.flag(present));
        end

    end

end
